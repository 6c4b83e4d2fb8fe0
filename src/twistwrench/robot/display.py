"""What a robot shows of itself: plain data for programs, a table in notebooks."""

from __future__ import annotations

from typing import Any

_SHOWN = ("joint", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort")


class DisplayMethods:
    """The methods of a robot that describe it."""

    def info(self: Any) -> dict[str, Any]:
        """Robot description as plain data: joints, links with mass, frames, gravity, defects; what ``info --json`` prints.

        Returns
        -------
        info : dict, of what ``json.dumps`` takes
            ``name``, ``nq``, ``nv``, ``gravity`` [m/s²], ``tip``, ``moving_mass`` and ``fixed_mass`` [kg], ``joints``,
            ``links`` (``mass``, ``com`` [m], ``moment_about_com`` [kg m²]), ``frames``, ``defects``; SI units and radians.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().info()["joints"][0]["effort"]
        150.0
        """
        from ..report.robot_summary import summary

        return summary(self)

    def _repr_html_(self: Any) -> str:
        from ..core.html_table import html_table
        from ..core.printed_numbers import number
        from ..report.robot_summary import joint_rows

        rows = joint_rows(self.model)
        defects = f", {len(self.defects)} defects" if self.defects else ""
        mass = number(self.model.moving_mass)
        title = f"{self.name}: nq = {self.nq}, nv = {self.nv}, {mass} kg moving, tip {self.tip}{defects}"
        return html_table(
            title, [name.replace("_", " ") for name in _SHOWN], ([row[name] for name in _SHOWN] for row in rows)
        )
