/*
 * The part of the CUDA driver and of NVRTC that the package calls, over the memory of the processor: what test_cuda_calls.py
 * puts in their place. "Device memory" is what was allocated here or registered by a test; "code" is the name of a shared
 * library that a C++ compiler made of the very source; a launch runs it. Calls are written down; any can be told to fail.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SUCCESS, INVALID_VALUE, INVALID_IMAGE = 200, INVALID_CONTEXT = 201, NOT_FOUND = 500 };
enum { DEVICES = 2, MOST_BLOCKS_OF_MEMORY = 1024, MOST_ARGUMENTS = 32, COMPILATION = 6 };

static char history[1 << 18], folder[256];
static char failing[64];
static int failure;

/* Write a call down; its result is SUCCESS, or what a test wants. */
static int called(const char *name, const char *format, ...)
{
    size_t used = strlen(history);
    va_list rest;
    va_start(rest, format);
    used += (size_t)snprintf(history + used, sizeof history - used, "%s ", name);
    used += (size_t)vsnprintf(history + used, sizeof history - used, format, rest);
    snprintf(history + used, sizeof history - used, "\n");
    va_end(rest);
    if (strcmp(name, failing))
        return SUCCESS;
    failing[0] = 0;
    return failure;
}

/* ── for the tests ── */

static struct { uintptr_t first, size; int device, owned; } memory[MOST_BLOCKS_OF_MEMORY];
static int contexts[DEVICES], *stack[16], depth;

const char *fake_history(void) { return history; }

void fake_folder(const char *path) { snprintf(folder, sizeof folder, "%s", path); }

void fake_fail(const char *name, int code)
{
    snprintf(failing, sizeof failing, "%s", name);
    failure = code;
}

void fake_register(uintptr_t first, uintptr_t size, int device, int owned)
{
    for (int k = 0; k < MOST_BLOCKS_OF_MEMORY; k++)
        if (!memory[k].size) {
            memory[k].first = first, memory[k].size = size, memory[k].device = device, memory[k].owned = owned;
            return;
        }
    abort();
}

int fake_allocated(void)
{
    int count = 0;
    for (int k = 0; k < MOST_BLOCKS_OF_MEMORY; k++)
        count += memory[k].size && memory[k].owned;
    return count;
}

void fake_reset(int device) /* whose context is current; none for -1 */
{
    history[0] = failing[0] = 0;
    depth = 0;
    if (device >= 0)
        stack[depth++] = &contexts[device];
}

int fake_depth(void) { return depth; }

/* ── the driver ── */

int cuInit(unsigned flags) { return called("cuInit", "%u", flags); }

int cuGetErrorName(int code, const char **text)
{
    *text = code == 700 ? "CUDA_ERROR_ILLEGAL_ADDRESS" : NULL;
    return *text ? SUCCESS : INVALID_VALUE;
}

int cuGetErrorString(int code, const char **text)
{
    *text = code == 700 ? "an illegal memory access was encountered" : NULL;
    return *text ? SUCCESS : INVALID_VALUE;
}

int cuPointerGetAttribute(void *found, int attribute, uintptr_t address)
{
    if (!depth)
        return INVALID_CONTEXT;
    if (attribute != 9)
        return INVALID_VALUE;
    for (int k = 0; k < MOST_BLOCKS_OF_MEMORY; k++)
        if (memory[k].size && address >= memory[k].first && address < memory[k].first + memory[k].size) {
            *(int *)found = memory[k].device;
            return SUCCESS;
        }
    return INVALID_VALUE;
}

int cuCtxGetCurrent(int **context)
{
    *context = depth ? stack[depth - 1] : NULL;
    return called("cuCtxGetCurrent", "");
}

int cuCtxGetDevice(int *device)
{
    if (!depth)
        return INVALID_CONTEXT;
    *device = (int)(stack[depth - 1] - contexts);
    return called("cuCtxGetDevice", "%d", *device);
}

int cuCtxPushCurrent_v2(int *context)
{
    stack[depth++] = context;
    return called("cuCtxPushCurrent_v2", "%d", (int)(context - contexts));
}

int cuCtxPopCurrent_v2(int **context)
{
    *context = stack[--depth];
    return called("cuCtxPopCurrent_v2", "%d", (int)(*context - contexts));
}

int cuDeviceGet(int *device, int number)
{
    *device = number;
    return number < DEVICES ? called("cuDeviceGet", "%d", number) : 101;
}

int cuDeviceGetAttribute(int *found, int attribute, int device)
{
    *found = attribute == 75 ? 9 : 0;
    return called("cuDeviceGetAttribute", "%d %d", attribute, device);
}

int cuDevicePrimaryCtxRetain(int **context, int device)
{
    *context = &contexts[device];
    return called("cuDevicePrimaryCtxRetain", "%d", device);
}

int cuModuleLoadData(void **module, const char *image)
{
    if (!depth)
        return INVALID_CONTEXT;
    *module = dlopen(image, RTLD_NOW | RTLD_LOCAL);
    return *module ? called("cuModuleLoadData", "on %d", (int)(stack[depth - 1] - contexts)) : INVALID_IMAGE;
}

static struct { void *code; int arguments; char name[256]; } functions[256];

int cuModuleGetFunction(void **function, void *module, const char *name)
{
    static int count;
    char label[300];
    snprintf(label, sizeof label, "arguments_of_%s", name);
    void *code = dlsym(module, name);
    int *arguments = dlsym(module, label);
    if (!code || !arguments)
        return NOT_FOUND;
    functions[count].code = code, functions[count].arguments = *arguments;
    snprintf(functions[count].name, sizeof functions[count].name, "%s", name);
    *function = &functions[count++];
    return called("cuModuleGetFunction", "%s", name);
}

int cuLaunchKernel(void *function, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz,
                   unsigned shared, uintptr_t stream, void **parameters, void **extra)
{
    typedef void Code(int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                      int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                      int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t);
    int64_t a[24] = {0};
    const int index = (int)(((char *)function - (char *)functions) / (int)sizeof functions[0]);
    if (!depth || extra || functions[index].arguments > 24)
        return INVALID_VALUE;
    for (int k = 0; k < functions[index].arguments; k++) /* each is an address or an integer of 64 bits */
        memcpy(&a[k], parameters[k], 8);
    int code = called("cuLaunchKernel", "%s grid %u,%u,%u block %u,%u,%u shared %u stream %llu", functions[index].name,
                      gx, gy, gz, bx, by, bz, shared, (unsigned long long)stream);
    if (!code)
        ((Code *)functions[index].code)(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12],
                                        a[13], a[14], a[15], a[16], a[17], a[18], a[19], a[20], a[21], a[22], a[23]);
    return code;
}

int cuEventCreate(void **event, unsigned flags)
{
    *event = malloc(1);
    return called("cuEventCreate", "%u", flags);
}

int cuEventRecord(void *event, uintptr_t stream)
{
    (void)event;
    return called("cuEventRecord", "stream %llu", (unsigned long long)stream);
}

int cuStreamWaitEvent(uintptr_t stream, void *event, unsigned flags)
{
    (void)event;
    return called("cuStreamWaitEvent", "stream %llu flags %u", (unsigned long long)stream, flags);
}

int cuEventDestroy_v2(void *event)
{
    free(event);
    return called("cuEventDestroy_v2", "");
}

int cuMemAlloc_v2(uint64_t *address, size_t size)
{
    if (!depth)
        return INVALID_CONTEXT;
    *address = (uint64_t)(uintptr_t)malloc(size);
    fake_register((uintptr_t)*address, size, (int)(stack[depth - 1] - contexts), 1);
    return called("cuMemAlloc_v2", "%zu", size);
}

int cuMemFree_v2(uint64_t address)
{
    for (int k = 0; k < MOST_BLOCKS_OF_MEMORY; k++)
        if (memory[k].size && memory[k].owned && memory[k].first == address) {
            memory[k].size = 0;
            free((void *)(uintptr_t)address);
            return called("cuMemFree_v2", "");
        }
    return INVALID_VALUE;
}

int cuMemcpyHtoD_v2(uint64_t address, const void *host, size_t size)
{
    memcpy((void *)(uintptr_t)address, host, size);
    return called("cuMemcpyHtoD_v2", "%zu", size);
}

int cuMemcpyDtoH_v2(void *host, uint64_t address, size_t size)
{
    memcpy(host, (void *)(uintptr_t)address, size);
    return called("cuMemcpyDtoH_v2", "%zu", size);
}

int cuStreamSynchronize(uintptr_t stream) { return called("cuStreamSynchronize", "stream %llu", (unsigned long long)stream); }

/* ── NVRTC ── */

typedef struct { char *source, name[256], image[300], kind[8]; } Program;

static const char ERRORS[] = "kernel.cu(1): error: this is the log";

const char *nvrtcGetErrorString(int code) { return code == COMPILATION ? "NVRTC_ERROR_COMPILATION" : "NVRTC_ERROR_OTHER"; }

int nvrtcVersion(int *major, int *minor)
{
    *major = 12, *minor = 9;
    return called("nvrtcVersion", "");
}

int nvrtcGetNumSupportedArchs(int *count)
{
    *count = 2;
    return SUCCESS;
}

int nvrtcGetSupportedArchs(int *known)
{
    known[0] = 80, known[1] = 90;
    return SUCCESS;
}

int nvrtcCreateProgram(Program **program, const char *source, const char *name, int headers, const char **texts,
                       const char **names)
{
    (void)texts, (void)names;
    *program = calloc(1, sizeof **program);
    (*program)->source = strdup(source);
    snprintf((*program)->name, sizeof (*program)->name, "%.*s", (int)(strlen(name) - 3), name);
    return called("nvrtcCreateProgram", "%s %d", name, headers);
}

int nvrtcCompileProgram(Program *program, int count, const char **options)
{
    char text[1024] = "", file[320], command[1024];
    for (int k = 0; k < count; k++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s ", options[k]);
    if (called("nvrtcCompileProgram", "%s", text))
        return COMPILATION;
    snprintf(program->kind, sizeof program->kind, "%s", strstr(text, "=sm_") ? "CUBIN" : "PTX");
    snprintf(program->image, sizeof program->image, "%s/code-XXXXXX", folder);
    if (mkstemp(program->image) < 0)
        return COMPILATION;
    snprintf(file, sizeof file, "%s.cpp", program->image);
    FILE *out = fopen(file, "w");
    fputs(program->source, out);
    snprintf(command, sizeof command, " %s(\n", program->name);
    const char *parameters = strstr(program->source, command);
    int arguments = 1;
    for (const char *c = parameters; c && !(c[0] == ')' && c[1] == '\n' && c[2] == '{'); c++)
        arguments += *c == ',';
    fprintf(out, "extern \"C\" { extern const int arguments_of_%s; const int arguments_of_%s = %d; }\n", program->name,
            program->name, arguments);
    fclose(out);
    snprintf(command, sizeof command, "c++ -std=c++17 -O0 -ffp-contract=off -shared -fPIC %s -o %s -lm", file,
             program->image);
    return system(command) ? COMPILATION : SUCCESS;
}

static int size_of(const Program *program, const char *kind, size_t *size)
{
    *size = strlen(program->image) + 1;
    return strcmp(program->kind, kind) ? COMPILATION : SUCCESS;
}

int nvrtcGetCUBINSize(Program *program, size_t *size) { return size_of(program, "CUBIN", size); }
int nvrtcGetPTXSize(Program *program, size_t *size) { return size_of(program, "PTX", size); }

int nvrtcGetCUBIN(Program *program, char *code)
{
    strcpy(code, program->image);
    return called("nvrtcGetCUBIN", "");
}

int nvrtcGetPTX(Program *program, char *code)
{
    strcpy(code, program->image);
    return called("nvrtcGetPTX", "");
}

int nvrtcGetProgramLogSize(Program *program, size_t *size)
{
    (void)program;
    *size = sizeof ERRORS;
    return SUCCESS;
}

int nvrtcGetProgramLog(Program *program, char *text)
{
    (void)program;
    strcpy(text, ERRORS);
    return SUCCESS;
}

int nvrtcDestroyProgram(Program **program)
{
    free((*program)->source);
    free(*program);
    return called("nvrtcDestroyProgram", "");
}
