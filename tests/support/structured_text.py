"""An interpreter of Structured Text over the tree of the parser blark; a variable may hold many states at once."""

import operator

import numpy as np

BINARY = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "<": operator.lt, ">": operator.gt, "<=": operator.le,
}  # fmt: skip
FUNCTIONS = {
    "SQRT": np.sqrt, "SIN": np.sin, "COS": np.cos, "EXP": np.exp, "ABS": np.abs, "MIN": np.minimum, "MAX": np.maximum,
    "SEL": lambda which, a, b: np.where(which, b, a).astype(a.dtype),
}  # fmt: skip
REALS = {"LREAL": np.float64, "REAL": np.float32}


def blocks(text):
    """Programs, function blocks and methods of a text, by their names in capitals."""
    from blark.parse import parse_source_code

    return {str(item.name).upper(): item for item in parse_source_code(text).transform().items}


class Instance:
    """A function block or a program with its variables, by their names in capitals; arrays are lists."""

    def __init__(self, known, name):
        self.known, self.block, self.values = known, known[name.upper()], {}
        self.real = np.float64 if "LREAL" in str(self.block) else np.float32
        for init, variables in ((x.init, x.variables) for part in self.block.declarations for x in part.items):
            self.values |= {self.key(v): self.initial(init) for v in variables}

    def key(self, node):
        return str(getattr(node, "name", node)).upper()

    def initial(self, init):
        words = str(init).upper().split(":=")[0].split()
        if "ARRAY" in words:
            size = int(init.spec.subranges[0].stop.value) + 1
            given = list(self.flat(init.value)) if init.value else [self.real(0)] * size
            assert len(given) == size
            return given
        return Instance(self.known, words[-1]) if words[-1] in self.known else REALS.get(words[-1], int)(0)

    def flat(self, listed):
        for e in (x.element for x in listed.elements):  # the parser nests what follows a negative number
            yield from self.flat(e) if hasattr(e, "elements") else [self.value(e)]

    def run(self, **inputs):
        """Run once; inputs are lists of elements."""
        for name, value in inputs.items():
            assert len(value) == len(self.values[name.upper()])
            self.values[name.upper()] = list(value)
        self.execute(self.block.body)
        return self.values

    def execute(self, statements):
        for s in statements.statements:
            getattr(self, type(s).__name__)(s)

    def AssignmentStatement(self, s):
        (variable,), value = s.variables, self.value(s.expression)
        if hasattr(variable, "elements"):
            self.values[self.key(variable.name)][self.index(variable)] = value
        else:
            assert self.key(variable) in self.values, f"{variable} is not declared"
            self.values[self.key(variable)] = value

    def ForStatement(self, s):
        for k in range(int(self.value(s.from_)), int(self.value(s.to)) + 1):
            self.values[self.key(s.control)] = k
            self.execute(s.statements)

    def IfStatement(self, s):
        if self.value(s.if_expression):
            self.execute(s.statements)

    def FunctionCallStatement(self, s):
        self.values[self.key(s.name)].run(**{str(p.name): self.value(p.value) for p in s.parameters})

    def index(self, variable):
        return int(self.value(variable.elements[-1].subscripts[0]))

    def value(self, e):
        kind = type(e).__name__
        if kind in ("Integer", "Real", "Boolean"):
            return {"Integer": int, "Real": self.real, "Boolean": lambda x: str(x).upper() == "TRUE"}[kind](e.value)
        if kind == "SimpleVariable":
            return self.values[self.key(e)]
        if kind == "MultiElementVariable":
            found = self.values[self.key(e.name)]
            for field in (x.field for x in e.elements[:-1]):
                found = found.values[self.key(field)]
            return found[self.index(e)]
        if kind == "ParenthesizedExpression":
            return self.value(e.expr)
        if kind == "UnaryOperation":
            x = self.value(e.expr)
            return -x if str(e.op) == "-" else not x
        if kind == "BinaryOperation":
            return BINARY[str(e.op)](self.value(e.left), self.value(e.right))
        assert kind == "FunctionCall", kind
        return FUNCTIONS[self.key(e.name)](*(self.value(p.value) for p in e.parameters))
