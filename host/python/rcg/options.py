"""Options that are numbers."""

import math
import operator
from typing import Any


def whole(name: str, value: Any, least: int, most: int) -> int | None:
    """``value`` as a whole number, or ``None``; ``ValueError`` that names ``name`` if it is neither."""
    if value is None:
        return None
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, bool) or not least <= number <= most:
        raise ValueError(f"{name}: expected a whole number from {least} to {most}, found {value}")
    return number


def finite(name: str, value: Any) -> float | None:
    """``value`` as a finite number, or ``None``; ``ValueError`` that names ``name`` if it is neither."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, str) or not math.isfinite(number):
        raise ValueError(f"{name}: expected a finite number, found {value}")
    return number
