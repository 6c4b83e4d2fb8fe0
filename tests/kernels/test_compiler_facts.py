"""What LLVM says of the processor is kept, and never taken for another processor, another llvmlite, or from a damaged entry."""

from __future__ import annotations

import sys

import pytest

from twistwrench.compiler.lowering import target_machine
from twistwrench.core import object_cache

CPUINFO = "processor\t: {core}\nvendor_id\t: X\nmodel name\t: {name}\ncpu MHz\t\t: {speed}\nflags\t\t: fpu {flags}\n\nprocessor\t: 9\n\n"


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """What is known without loading LLVM, by a description of the processor; and how often LLVM was asked."""
    llvm = pytest.importorskip("llvmlite.binding")
    monkeypatch.setenv(object_cache.VARIABLE, str(tmp_path / "cache"))
    count = []
    truth = target_machine._llvm_facts

    def ask():
        count.append(1)
        return truth()

    monkeypatch.setattr(target_machine, "_llvm_facts", ask)
    monkeypatch.setattr(target_machine, "_CPUINFO", tmp_path / "cpuinfo")
    assert llvm

    def known(text: str | None = None, **changes: str) -> tuple[target_machine.CompilerFacts, int]:
        about = {"core": "0", "name": "Y", "speed": "1000", "flags": "avx2", **changes}
        (tmp_path / "cpuinfo").write_text(CPUINFO.format(**about) if text is None else text)
        target_machine._cached_facts.cache_clear()
        before = len(count)
        return target_machine._cached_facts(), len(count) - before

    yield known
    target_machine._cached_facts.cache_clear()


def test_it_is_asked_once_for_each_processor(asked):
    first, count = asked()
    assert (first, count) == (target_machine._llvm_facts(), 1)
    assert asked() == (first, 0)
    assert asked(core="3", speed="2000") == (first, 0)  # another core of it, at another moment
    assert asked(flags="avx512f")[1] == 1
    assert asked(name="Z")[1] == 1
    assert asked() == (first, 0)


def test_an_emulator_that_lends_fewer_features_is_another_processor(asked, monkeypatch):
    from numpy._core import _multiarray_umath

    asked()
    fewer = dict.fromkeys(_multiarray_umath.__cpu_features__, False)
    monkeypatch.setattr(_multiarray_umath, "__cpu_features__", fewer | {"SSE": True})
    assert asked()[1] == 1


def test_another_llvmlite_is_asked_itself(asked, monkeypatch):
    asked()
    monkeypatch.setattr(sys.modules["llvmlite"], "__version__", "0.0.1")
    assert asked()[1] == 1


@pytest.mark.parametrize("text", ["", "nothing of flags\n\n", "flags: fpu avx, and no end", "\0" * 9000])
def test_where_the_system_does_not_say_which_processor_nothing_is_kept(asked, text):
    assert asked(text)[1] == 1
    assert asked(text)[1] == 1


@pytest.mark.parametrize("kept", [b"", b"one line", b"1\n2\n3\n4\n5", b"1\n\xff\n3\n4"])
def test_an_entry_of_another_form_is_made_again(asked, tmp_path, kept):
    first, _ = asked()
    (entry,) = (tmp_path / "cache").iterdir()
    object_cache.store(entry.name, kept)
    assert asked() == (first, 1)
    assert asked() == (first, 0)


def test_where_llvm_is_loaded_it_is_asked_itself(asked, monkeypatch):
    first, _ = asked()
    monkeypatch.setattr(target_machine, "_llvm_facts", lambda: first._replace(cpu="newer"))
    assert target_machine.compiler().cpu == "newer"
