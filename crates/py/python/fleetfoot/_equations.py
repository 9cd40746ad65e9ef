"""Content of a model in Python: functions, coefficients, equations as text."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from .exceptions import ModelError


class Content:
    """Content of a model's file."""

    def __init__(self, text: str) -> None:
        content = json.loads(text)["model"]
        self.columns: list[dict[str, Any]] = content["columns"]
        self.libraries: list[list[str]] = content["libraries"]
        self.partitions: list[dict[str, Any]] = content["partitions"]
        self.latents: list[dict[str, Any]] = content["latents"]
        self.equations_: list[dict[str, Any]] = content["equations"]
        self.method: str = content["method"]
        self.training: dict[str, Any] = content["training"]

    def latent(self, name: str | None) -> dict[str, Any]:
        """The latent of a name."""
        for latent in self.latents:
            if latent["name"] == name:
                return latent
        names = ", ".join(latent["name"] for latent in self.latents)
        raise ModelError(f"there is no latent {name!r}; the model has {names}")

    def fitted(self) -> list[dict[str, Any]]:
        """The equations that were fitted."""
        return [equation for equation in self.equations_ if equation["target"] is not None]

    def latent_of(self, equation: dict[str, Any]) -> dict[str, Any] | None:
        """The latent function of a right side that is a single latent."""
        name = equation["right"].strip("`")
        return next((latent for latent in self.latents if latent["name"] == name), None)

    def of_one_library(self) -> list[dict[str, Any]]:
        """The latent functions of the fitted equations, if each has one and all share functions and regions."""
        latents = self.latents
        shapes = {(latent["library"], latent["partition"]) for latent in latents}
        if len(shapes) != 1:
            names = ", ".join(latent["name"] for latent in latents) or "no latents"
            raise ModelError(f"the equations do not share one library ({names}); name the latent: latent=...")
        return latents

    def feature_names(self, latent: str | None) -> list[str]:
        """Functions of a library, the constant first."""
        of_latent = self.of_one_library()[0] if latent is None else self.latent(latent)
        return ["1", *self.features(of_latent)]

    def features(self, latent: dict[str, Any]) -> list[str]:
        """The features of a latent: the functions of its library, then its radial functions or its network's units."""
        names_used: list[str] = []
        for kind, name in (("radial", "radial"), ("network", "unit")):
            if kind in latent:
                names_used = [f"{name}{at + 1}" for at in range(len(latent[kind]["weights"][0]))]
        return [*self.libraries[latent["library"]], *names_used]

    def weights(self, latent: dict[str, Any], region: int) -> list[float]:
        """The coefficients of the features of a latent in a region."""
        further: list[Any] = next((latent[kind]["weights"][region] for kind in ("radial", "network") if kind in latent), [])
        return [*map(float, latent["coefficients"][region]), *map(float, further)]

    def coefficients(self, latent: str | None) -> np.ndarray[Any, Any]:
        """Regions x latents x functions."""
        latents = self.of_one_library() if latent is None else [self.latent(latent)]
        regions = len(latents[0]["constants"])
        rows = [
            [[float(one["constants"][region]), *self.weights(one, region)] for one in latents]
            for region in range(regions)
        ]
        return np.array(rows, dtype=float)

    def complexity(self) -> int:
        """Non-zero coefficients of all functions and regions."""
        rows = [
            [float(constant), *self.weights(latent, region)]
            for latent in self.latents
            for region, constant in enumerate(latent["constants"])
        ]
        return sum(int(np.count_nonzero(np.array(row, dtype=float))) for row in rows)

    def regions(self) -> list[str]:
        """Names of the regions in the first latent's partition."""
        if not self.latents:
            return ["all"]
        return [region["name"] for region in self.partitions[self.latents[0]["partition"]]["regions"]] or ["all"]

    def equations(self, precision: int, region: int | None) -> list[str]:
        """Equations as text; one per region if there are several."""
        lines, named = [], []
        for equation in self.equations_:
            left, latent = _left(equation), self.latent_of(equation)
            if latent is None:
                lines.append(f"{left} = {equation['right']}")
                continue
            named.append(latent["name"])
            lines += self._of_latent(left, latent, precision, region)
        for latent in self.latents:
            if latent["name"] not in named:
                lines += self._of_latent(latent["name"], latent, precision, region)
        return lines

    def _of_latent(self, left: str, latent: dict[str, Any], precision: int, region: int | None) -> list[str]:
        count = len(latent["constants"])
        if count == 1:
            return [f"{left} = {self._sum(latent, 0, precision)}"]
        names = [region["name"] for region in self.partitions[latent["partition"]]["regions"]]
        wanted = range(count) if region is None else [_checked(region, count)]
        return [f"region {names[at]}: {left} = {self._sum(latent, at, precision)}" for at in wanted]

    def _sum(self, latent: dict[str, Any], region: int, precision: int) -> str:
        terms = [("1", float(latent["constants"][region]))]
        terms += zip(self.features(latent), self.weights(latent, region))
        if "network" in latent:
            # Units mean nothing one by one.
            terms = [*terms[: 1 + len(self.libraries[latent["library"]])], (f"network_{latent['name']}", 1.0)]
        text = ""
        for function, coefficient in terms:
            if coefficient == 0.0:
                continue
            size = f"{abs(coefficient):.{precision}g}"
            product = size if function == "1" else f"{size}*{_factor(function)}"
            sign = "-" if coefficient < 0.0 else "+"
            text = f"{text} {sign} {product}" if text else product if sign == "+" else f"-{product}"
        return text or "0"


def _checked(region: int, count: int) -> int:
    if not 0 <= region < count:
        raise ModelError(f"region={region}: the model has the regions 0 to {count - 1}")
    return region


def _left(equation: dict[str, Any]) -> str:
    subject = str(equation["subject"])
    words = {"derivative": f"d({subject})/dt", "next": f"next({subject})", "delta": f"delta({subject})"}
    return words.get(str(equation["prediction"]), subject)


def _factor(function: str) -> str:
    """A function after a coefficient: a sum in parentheses."""
    depth, quoted, total = 0, False, function.startswith("-")
    for at, letter in enumerate(function):
        if letter == "`":
            quoted = not quoted
        elif letter in "([" and not quoted:
            depth += 1
        elif letter in ")]" and not quoted:
            depth -= 1
        elif letter in "+-" and not quoted and depth == 0 and function[:at].endswith(" "):
            total = True
    return f"({function})" if total else function
