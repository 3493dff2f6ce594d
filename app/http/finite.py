"""JSON knows no NaN and no infinity, and UTF-8 no half characters."""

import math
from typing import Any


def finite(value: Any) -> Any:
    """Any JSON-like value with NaN and infinities, which JSON has not, as null, half characters as ?, and unknown
    objects as words."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, dict):
        return {finite(str(key)): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [finite(item) for item in value]
    if value is None or isinstance(value, int | bool):
        return value
    return finite(str(value))
