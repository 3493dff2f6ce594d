"""JSON knows no NaN and no infinity."""

import math
from typing import Any


def finite(value: Any) -> Any:
    """Any JSON-like value with NaN and infinities, which JSON has not, as null; unknown objects as words."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [finite(item) for item in value]
    if value is None or isinstance(value, str | int | bool):
        return value
    return str(value)
