"""What decides the last bits of a computation, and which versions made it."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import msgspec

_BUILT_ON = ("crossfix", "eclipse-zenoh", "mcap", "msgpack", "msgspec", "numpy", "scipy")


class Fingerprint(msgspec.Struct, frozen=True, kw_only=True):
    """Equal fingerprints promise equal bytes; anything else is compared with a tolerance.

    Attributes:
        blas: library and the kernel it chose for this processor.
        simd: instruction sets numpy found.
        machine: processor family; libc: whose mathematical functions are used.
    """

    numpy: str = ""
    blas: str = ""
    simd: str = ""
    machine: str = ""
    libc: str = ""


def numeric_fingerprint() -> Fingerprint:
    """Of this process; imports numpy."""
    import numpy as np  # noqa: PLC0415 - readers of recordings need none of this
    from threadpoolctl import (  # type: ignore[import-untyped]  # noqa: PLC0415
        threadpool_info,
    )

    libraries = [info for info in threadpool_info() if info["user_api"] == "blas"]
    kernels = {f"{i['internal_api']} {i.get('architecture', '')}".strip() for i in libraries}
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return Fingerprint(
        numpy=np.__version__,
        blas=", ".join(sorted(kernels)),
        simd=" ".join([*simd.get("baseline", []), *simd.get("found", [])]),
        machine=platform.machine(),
        libc=" ".join(platform.libc_ver()).strip(),
    )


def installed_versions() -> dict[str, str]:
    """Package -> version, Python included; from the source tree crossfix has none."""
    versions = {"python": platform.python_version()}
    for name in _BUILT_ON:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions
