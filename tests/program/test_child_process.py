"""Child processes under limits: results as in this process, and one error for whatever a reader does to its process."""

from __future__ import annotations

import os
import pickle
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from twistwrench.core import child_process
from twistwrench.core.child_process import ChildLimits, run_in_child, sandboxed, stream_from_child
from twistwrench.core.errors import NotFoundError, TrajectoryError, ValueRangeError

QUICK = ChildLimits(seconds=0.2, memory=1 << 27, output=1 << 22)


def call(target, *args, limits=QUICK):
    return run_in_child(target, *args, limits=limits, error_of=lambda reason: TrajectoryError(f"a.log: {reason}."))


def test_plain_data_and_arrays_come_back_as_they_are():
    table = np.arange(12.0).reshape(3, 4)
    assert np.array_equal(call("numpy:transpose", table), table.T)
    assert call("builtins:dict", [("a", [1, 2.5, None, True, b"x", ("y",)])]) == {
        "a": [1, 2.5, None, True, b"x", ("y",)]
    }


@pytest.mark.parametrize(
    ("target", "args", "reason"),
    [
        ("ctypes:string_at", (0,), r"its reader crashed \(SIGSEGV\)"),
        ("os:abort", (), r"its reader crashed \(SIGABRT\)"),
        ("os:_exit", (3,), "its reader ended with code 3"),
        ("builtins:bytearray", (1 << 29,), "it needs more memory than its reader may use"),
        ("time:sleep", (60,), "reading it took longer than 0.6 s"),
        ("numpy:zeros", (1 << 20,), "its content takes more than 4 MiB once read"),
        ("builtins:bytes", (QUICK.output + 1,), "its content takes more than 4 MiB once read"),
        ("pathlib:Path", ("a",), "its reader returned what is not plain data"),
        ("math:sqrt", (-1.0,), "ValueError: "),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="names of signals, and limits of memory")
def test_what_a_reader_does_to_its_process_is_one_error_of_the_file(target, args, reason):
    with pytest.raises(TrajectoryError, match=f"^a.log: {reason}"):
        call(target, *args)
    assert call("math:hypot", 3.0, 4.0) == 5.0


def test_processor_time_is_limited():
    with pytest.raises(TrajectoryError, match=r"took (more|longer) than"):
        call("builtins:pow", 9, 9**9, limits=ChildLimits(seconds=0.1))


def test_errors_of_the_library_keep_their_class_and_text():
    with pytest.raises(NotFoundError, match=r"no motion file 'absent\.csv'"):
        call("twistwrench.motion.readers.csv_reader:CsvFile.open", "absent.csv")


def test_items_are_computed_when_they_are_wanted_and_the_rest_is_left():
    items = stream_from_child("itertools:count", 3, limits=QUICK, error_of=ValueRangeError)
    assert [next(items) for _ in range(4)] == [3, 4, 5, 6]
    items.close()
    assert list(stream_from_child("builtins:range", 3, limits=QUICK, error_of=ValueRangeError)) == [0, 1, 2]


def test_the_size_allowed_is_that_of_all_items_together():
    """Ten items of 1 MiB; 4 MiB are allowed."""
    items = stream_from_child("itertools:repeat", bytes(1 << 20), 10, limits=QUICK, error_of=ValueRangeError)
    with pytest.raises(ValueRangeError, match="its content takes more than"):
        list(items)


def test_each_item_has_the_whole_processor_time(monkeypatch):
    allowed = []
    monkeypatch.setattr(child_process, "_limit_memory", lambda memory: None)
    monkeypatch.setattr(child_process, "_limit_time", allowed.append)
    request = pickle.dumps(("builtins:range", (3,), QUICK, False, os.getcwd()))
    assert list(child_process._items(request)) == [0, 1, 2]
    assert allowed == [QUICK.seconds] * 4  # before each item, and before the end


def test_paths_in_a_child_are_relative_to_the_working_folder_of_the_call(monkeypatch, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert Path(call("os:getcwd")).samefile(tmp_path / name)


@pytest.mark.skipif(os.name == "nt", reason="no limits of a process")
def test_a_reader_that_crashes_leaves_no_core_file():
    import resource

    assert call("resource:getrlimit", resource.RLIMIT_CORE)[0] == 0


def test_one_child_serves_calls_one_after_another_and_several_at_once():
    first = call("os:getpid")
    assert call("os:getpid") == first != os.getpid()
    found = []
    calls = [threading.Thread(target=lambda: found.append(call("time:sleep", 0.01))) for _ in range(4)]
    for each in calls:
        each.start()
    for each in calls:
        each.join()
    assert found == [None] * 4
    assert len(child_process._idle[os.getpid()]) == 1


def test_a_child_that_ended_while_idle_is_replaced():
    os.kill(call("os:getpid"), 9)
    time.sleep(0.05)
    assert call("math:hypot", 3.0, 4.0) == 5.0


def test_a_child_imports_only_what_its_function_needs():
    assert "scipy" not in call("twistwrench.core.child_process:loaded_packages")


def test_the_environment_variable_decides(monkeypatch):
    for text, expected in {"1": True, "0": False, "": child_process.BY_DEFAULT}.items():
        monkeypatch.setenv("TWISTWRENCH_SANDBOX", text)
        assert sandboxed() is expected
    assert call("twistwrench.core.child_process:sandboxed") is False


def test_without_an_interpreter_files_are_read_in_this_process(monkeypatch):
    monkeypatch.delenv("TWISTWRENCH_SANDBOX", raising=False)
    child_process.end_children()
    for executable in ("", "/usr/bin/uwsgi", "/absent/python"):
        child_process._possible.cache_clear()
        monkeypatch.setattr("sys.executable", executable)
        assert not sandboxed()
    with pytest.raises(TrajectoryError, match="no child process can be started for its reader; TWISTWRENCH_SANDBOX=0"):
        call("math:hypot", 3.0, 4.0)
    child_process._possible.cache_clear()
