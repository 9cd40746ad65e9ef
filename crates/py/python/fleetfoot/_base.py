"""Base classes of the estimators: scikit-learn's where it is installed, else small ones that behave alike."""

from __future__ import annotations
