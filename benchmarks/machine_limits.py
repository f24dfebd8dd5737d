"""Sizes of the caches, for what is measured beside them."""

from __future__ import annotations


def cache_size() -> str:
    """Sizes of the caches, where the system tells."""
    from pathlib import Path

    found = []
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, size = ((index / name).read_text().strip() for name in ("level", "size"))
        if (index / "type").read_text().strip() != "Instruction":
            found.append(f"L{level} {size}")
    return ", ".join(found)


__all__ = ["cache_size"]
