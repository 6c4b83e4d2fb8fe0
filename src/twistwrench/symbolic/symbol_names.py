"""The parts of a symbol's name: letter, dots, index."""

from __future__ import annotations

import re

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "iota": "ι",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ",
    "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip

MARKS = {"ddot": "\u0308", "dot": "\u0307"}


def name_parts(name: str) -> tuple[str, str, str]:
    """Stem, mark and index of a symbol's name: thetadot_1 → theta, dot, 1."""
    stem, _, index = name.partition("_")
    for mark in MARKS:
        if stem.endswith(mark) and len(stem) > len(mark):
            return stem[: -len(mark)], mark, index
    return stem, "", index


def link_number(index: str) -> tuple[int, bool]:
    """The number of a link or joint, rotors (r1) after the links of the same number."""
    number = re.match(r"(r?)(\d+)", index)
    return (int(number[2]), bool(number[1])) if number else (0, False)
