"""A motion as columns, in files and in tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import as_path
from ..errors import MissingExtraError
from ..typing import Array
from .column_names import time_column


class MotionFiles:
    """The methods of a motion that give its columns."""

    def columns(self: Any, *, degrees: bool = False) -> dict[str, Array]:
        """Columns of the motion by the names that they have in files: the coordinate's, ``.vel``, ``.acc`` and ``.torque``.

        Parameters
        ----------
        degrees : bool, angles in degrees, which their columns' names then say: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        columns : {name: (n,) array}, time first

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 101)
        >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
        >>> list(motion.columns())[:3]
        ['time', 'joint1', 'joint2']
        """
        names = self.coordinates
        unit = np.degrees(1.0) if degrees else 1.0
        q = self.q * np.where(names.angular, unit, 1.0)
        turning = np.where(names.angular_velocity, unit, 1.0)
        parts: Mapping[str, Array | None] = {"dq": self.dq * turning, "ddq": self.ddq * turning, "tau": self.tau}
        found = {
            time_column(names.names): self.time,
            **{name: q[:, k] for k, name in enumerate(names.headers(degrees=degrees))},
        }
        for part, values in parts.items():
            if values is not None:
                found |= {name: values[:, k] for k, name in enumerate(names.headers(part, degrees=degrees))}
        return found

    def to_csv(self: Any, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads.

        Parameters
        ----------
        path : str or Path
        degrees : bool, angles in degrees, which the header then says: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            Nothing can be written.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 101)
        >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(motion.to_csv(f"{folder}/motion.csv").read_text().split(",")[0])
        time
        """
        from .table_file import TableFile

        path, columns = as_path(path), self.columns(degrees=degrees)
        with TableFile.writing(path, list(columns)) as file:
            if file is not None:
                file.write(np.column_stack(list(columns.values())))
        return path

    def to_pandas(self: Any) -> Any:
        """Data frame with the time [s] as its index and a column for each entry.

        Returns
        -------
        frame : pandas.DataFrame

        Raises
        ------
        MissingExtraError
            There is no pandas.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 101)
        >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
        >>> motion.to_pandas().shape
        (101, 6)
        """
        try:
            import pandas  # type: ignore[import-untyped]
        except ImportError:
            raise MissingExtraError.of("pandas", "tables", "Making a DataFrame") from None
        columns = self.columns()
        return pandas.DataFrame(columns).set_index(next(iter(columns)))

    def to_xarray(self: Any) -> Any:
        """Dataset of q, dq, ddq, and tau where it is known, whose axes are named: time, coordinate, joint.

        Returns
        -------
        dataset : xarray.Dataset

        Raises
        ------
        MissingExtraError
            There is no xarray.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 101)
        >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
        >>> motion.to_xarray().dq.sel(joint="joint2").shape
        (101,)
        """
        from .labelled_dataset import labelled_dataset

        arrays = {"q": self.q, "dq": self.dq, "ddq": self.ddq, **({} if self.tau is None else {"tau": self.tau})}
        return labelled_dataset(self.robot.model, self.time, arrays)
