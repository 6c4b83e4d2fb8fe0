"""Write docs/quantities.md from the table of quantities: `python docs/quantities.py`."""

from __future__ import annotations

from pathlib import Path

import twistwrench as tw
from twistwrench.core.first_calls import first_calls
from twistwrench.robot.derivatives import DerivativeMethods
from twistwrench.robot.quantities import QUANTITIES, Quantity
from twistwrench.robot.quantity_methods import QuantityMethods

PAGE = Path(__file__).with_name("quantities.md")
_HEAD = """# Quantities

Quantities of a robot are available in four forms:

* a method of the robot, for arrays with any leading batch shape;
* a kernel, `robot.kernel(name)`: a `numpy.ufunc` with the robot's own sizes;
* a function of [exported C](export.md);
* a [CUDA kernel](export.md#cuda).

Those marked ° are kernels only; methods use them. Terms are those of the [glossary](glossary.md). `python docs/quantities.py`
writes this page from the table in `src/twistwrench/robot/quantities.py`.

```python
import twistwrench as tw

panda = tw.robots.panda()
assert panda.kernel("inverse_dynamics").signature == "(7),(7),(7)->(7)"
assert panda.program("inverse_dynamics").flops < 1500
```

## Inputs and outputs

nq and nv are the numbers of coordinates and of velocities. Angular parts come first. Quantities take the options of
derivatives ([`by=`](derivatives.md)) and `parameters=` in addition to their own.

| input | shape | meaning | unit |
| --- | --- | --- | --- |
| `q`, `q0`, `q1` | nq | configuration | rad, m; quaternions (w, x, y, z) |
| `dq` | nv | velocities | rad/s, m/s |
| `ddq` | nv | accelerations | rad/s², m/s² |
| `tau`, `load` | nv | torques | N m (sliding joints: N) |
| `dv` | nv | joint twists for unit time | rad, m |
| `wrench` | 6 | wrench (m, f) by the robot at the frame, in its axes | N m, N |

"""
_COSTS = """
## Names in other libraries, and operations

Sections and equations are those of Modern Robotics (Lynch and Park, 2017). Pinocchio puts the linear part of a twist
first, and MuJoCo returns the two parts of a Jacobian separately; [`twistwrench.robot.convert`](conventions.md) translates.
Quantities marked "M⁻¹" need an invertible mass matrix. They raise `SingularMassMatrixError` if a joint moves nothing
with inertia. On a [robot with constraints](constraints.md), quantities are those of its open tree ("as is"), include constraint
forces ("projected"), or are not available ("refused"). Operations are additions, multiplications and divisions for one state of
the bundled Panda with its seven joints; sines and cosines are not counted.
"""
_INPUTS = {"q", "q0", "q1", "dq", "ddq", "tau", "load", "dv", "wrench"}


def page() -> str:
    """The page, as it has to be."""
    panda = tw.robots.panda()
    assert {name for row in QUANTITIES.values() for name in row.inputs} == _INPUTS
    shapes = [
        (_name(name), row.meaning, _list(row.inputs), _outputs(row), row.unit, _list(row.options))
        for name, row in QUANTITIES.items()
    ]
    costs = [
        (
            _name(name),
            row.book,
            _code(names["Pinocchio"]),
            _code(names["MuJoCo"]),
            "M⁻¹" if row.needs_inverse else "",
            row.constrained,
            _flops(panda, row, name),
        )
        for name, row, names in ((name, row, _names_of(name)) for name, row in QUANTITIES.items())
    ]
    return "\n".join(
        (
            _HEAD + _table(("quantity", "meaning", "inputs", "outputs", "unit", "options"), shapes),
            _COSTS,
            _table(
                ("quantity", "book", "Pinocchio", "MuJoCo", "needs", "with constraints", "operations"),
                costs,
                right=(6,),
            ),
            "",
        )
    )


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]], right: tuple[int, ...] = ()) -> str:
    rule = ("---:" if k in right else "---" for k in range(len(heads)))
    return "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in (heads, tuple(rule), *rows)
    )


def _name(name: str) -> str:
    return f"`{name}`" + ("" if name in {*vars(QuantityMethods), *vars(DerivativeMethods)} else "°")


def _names_of(quantity: str) -> dict[str, str]:
    """Names of the first row for a quantity in each library, from the table of first calls."""
    found = {row.of: " ".join(row.words) for row in reversed(first_calls()) if row.quantity == quantity}
    return {"Pinocchio": "", "MuJoCo": "", **found}


def _code(names: str) -> str:
    return ", ".join(f"`{name}`" for name in names.split())


def _list(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _outputs(row: Quantity) -> str:
    return ", ".join(f"`{name}` ({', '.join(axes)})" for name, axes in zip(row.outputs, row.sizes, strict=True))


def _flops(robot: tw.Robot, row: Quantity, name: str) -> str:
    return "" if "constraints" in row.options else f"{robot.program(name).flops:,}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
