"""Requests to the engine, as dictionaries."""

from __future__ import annotations

from typing import TypedDict


class StlsqRequest(TypedDict):
    """Options of STLSQ."""

    threshold: float
    alpha: float
    max_iter: int
    normalize: bool
    unbias: bool
    fixed: list[int]


class Sr3Request(TypedDict):
    """Options of SR3."""

    regularizer: str
    nu: float
    tol: float
    max_iter: int
    normalize: bool
    unbias: bool


class FrolsRequest(TypedDict):
    """Options of forward regression."""

    max_terms: int
    alpha: float
    kappa: float
    normalize: bool
    unbias: bool


class PwaRequest(TypedDict):
    """Options of regions and their choice."""

    partitions: str
    features: list[int]
    groups: list[int]
    folds: int
    shrinkage: float | None
    continuous: bool
    bic: bool
    seed: int
    restarts: int
    max_iter: int


class PwaRule(TypedDict):
    """Rule that assigns a row to a region."""

    features: list[int]
    centre: list[float]
    scale: list[float]
    weights: list[list[float]]
    offsets: list[float]
    joined: list[int]
    cuts: list[tuple[int, float, int, int]]
    radius: float | None
    half: float | None
