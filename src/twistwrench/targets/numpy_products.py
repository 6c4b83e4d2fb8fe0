"""Products on whole arrays: the fallback where nothing compiles, and the oracle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..program.products import AFTER, BEFORE, Products
from ..typing import Array
from .numpy import NumpyKernel


class NumpyProducts:
    """Callable like the compiled ufunc of the same products."""

    def __init__(self, products: Products, name: str, doc: str) -> None:
        self.products, self.__name__, self.__doc__ = products, name, doc
        self.signature, self.nin, self.nout = products.signature, len(products.inputs), len(products.outputs)
        self.kernel = NumpyKernel(products.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpyProducts {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes are the signature's."""
        factors, relations = self.kernel(*args), np.array(self.products.relations)
        found: list[Array] = []
        for matrix in self.products.matrices:
            before, after = (factors[a] @ factors[b] for a, b in (matrix.before, matrix.after))
            M: Array = np.where(relations == BEFORE, before, np.where(relations == AFTER, after, before.dtype.type(0)))
            for r, c, x in matrix.added:
                M[..., r, c] += x
            found.append(M)
        if out is not None:
            places = out if isinstance(out, tuple) else (out,)
            for k, place in enumerate(places):
                if place is not None:
                    np.copyto(place, found[k], casting="same_kind")
                    found[k] = place
        return found[0] if self.nout == 1 else tuple(found)
