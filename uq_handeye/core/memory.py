"""Memory that is free for this process, to check a limit that is known before the work begins."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ..errors import InputError

# What helps where files have more poses than memory serves.
FEWER_POSES = "Give fewer poses, such as every second row of the files."
_MEMINFO, _CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def free_bytes() -> int | None:
    """Return the memory that this process can still take, by the kernel, its control group and its limit.

    None where the system does not tell, as outside Linux.
    """
    found = []
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in _MEMINFO.read_text().splitlines() if line.startswith("MemAvailable:"))
        found.append(1024 * int(line.split()[1]))
    with suppress(OSError, ValueError):  # "max" is no number
        limit, used = (int((_CGROUP / name).read_text()) for name in ("memory.max", "memory.current"))
        found.append(max(limit - used, 0))
    with suppress(ImportError, OSError, ValueError):
        import resource

        soft = resource.getrlimit(resource.RLIMIT_AS)[0]
        if soft != resource.RLIM_INFINITY:
            taken = 4096 * int(Path("/proc/self/statm").read_text().split()[0])
            found.append(max(soft - taken, 0))
    return min(found, default=None)


def require_memory(needed: float, what: str, remedy: str) -> None:
    """Raise `InputError` where ``what`` needs more memory (bytes) than is free."""
    free = free_bytes()
    if free is not None and needed > free:
        raise InputError(
            f"{what} needs about {needed / 1e9:.2g} GB of memory, and {free / 1e9:.2g} GB are free. {remedy}"
        )
