"""The one owner of numba's flags and of its cache on disk.

numba's file cache looks at the file of the decorated function alone: an edit in a module that it
*imports* leaves stale machine code running, silently. So every function is cached in a folder named
by a hash of its file, of all files of this package that the file imports, directly or not, and of the
versions of numba and Python: an edit of any of them starts an empty folder. Import numba through
this module only.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import pickle
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from numba.core.cgutils import alloca_once, false_bit
from numba.extending import intrinsic

_PACKAGE = Path(__file__).parent
# By pattern and not by ``ast``: a warm start reads some twenty files.
_IMPORT = re.compile(
    rf"^\s*(?:from\s+(?P<module>{_PACKAGE.name}[\w.]*)\s+import\s+(?P<names>\([^)]*\)|[^\n]*)"
    rf"|import\s+(?P<plain>{_PACKAGE.name}[\w.]*))",
    re.MULTILINE,
)
_UNUSED_FOR_S = 7 * 86400.0


def _cache_root() -> Path:
    """The user's cache folder, or a private one among the temporary files where that cannot be written."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    root = base / "firmware-sim"
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError:
        root = Path(tempfile.gettempdir()) / f"firmware-sim-{os.getuid()}"
        root.mkdir(mode=0o700, exist_ok=True)
    return root


def _forget_unused(root: Path) -> None:
    """Remove what no run has used for a week; every run marks what it uses."""
    oldest = time.time() - _UNUSED_FOR_S
    for path in root.iterdir():
        if path.is_dir() and path.stat().st_mtime < oldest:
            shutil.rmtree(path, ignore_errors=True)


CACHE_ROOT = _cache_root()
_forget_unused(CACHE_ROOT)


@functools.cache
def _imports_of(source: Path) -> frozenset[Path]:
    """The files of this package that ``source`` imports by name, wherever in it the import stands."""
    modules: set[str] = set()
    for match in _IMPORT.finditer(source.read_text(encoding="utf-8")):
        module = match["module"] or match["plain"]
        modules |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", match["names"] or ""))}
    files = {_PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py") for module in modules if "." in module}
    return frozenset(path for path in files if path.is_file())


@functools.cache
def _fingerprint(source: Path) -> str:
    """Hash of a file and of all that it imports from this package, and of what compiles them."""
    digest = hashlib.sha256(f"{numba.__version__} {platform.python_version()} {platform.machine()}".encode())
    closure: set[Path] = set()
    waiting = {source, Path(__file__)}
    while waiting:
        path = waiting.pop()
        closure.add(path)
        waiting |= _imports_of(path) - closure
    # By the whole path: two rooms may have a file of one name, whose order would be another in each process.
    for path in sorted(closure):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def jit(function: Callable[..., Any]) -> Any:
    """Compile with numba: cached on disk, IEEE arithmetic in the order of the source, no Python objects, no new arrays.

    ``fastmath`` stays off: re-association would make results depend on the processor that compiled them. References to
    arrays are not counted, which would take most of the time of a function that works on small ones; so numba refuses
    to compile here what makes an array.
    """
    return _compiled(function, makes_arrays=False)


def jit_with_arrays(function: Callable[..., Any]) -> Any:
    """As ``jit``, for a function that makes arrays, on the heap or by ``carray``."""
    return _compiled(function, makes_arrays=True)


def _compiled(function: Callable[..., Any], makes_arrays: bool) -> Any:
    folder = CACHE_ROOT / _fingerprint(Path(function.__code__.co_filename))
    folder.mkdir(exist_ok=True)
    os.utime(folder)
    vars(numba.config)["CACHE_DIR"] = str(folder)  # read by numba while it decorates
    return _numba.njit(cache=True, error_model="numpy", _nrt=makes_arrays)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """A ``jit`` function without a call of its own: in the interpreter's loop a call costs as much as an addition."""
    dispatcher = jit(function)
    dispatcher.targetoptions["forceinline"] = True
    return dispatcher


def is_compiled(function: Any) -> bool:
    """Whether the machine code of a ``jit`` function is in memory or on disk, so that its first call is quick."""
    source = Path(function.py_func.__code__.co_filename)
    folder = CACHE_ROOT / _fingerprint(source)
    return bool(function.signatures) or any(folder.rglob(f"{source.stem}.{function.py_func.__name__}-*.nbi"))


def remembered(name: str, key: str, module_file: str, make: Callable[[], Any]) -> Any:
    """What ``make`` makes, or what it made for the same ``key`` and the same sources before: kept in the cache.

    ``module_file`` is the file of the module that makes it; an edit of it or of what it imports makes it anew.
    """
    digest = hashlib.sha256(f"{_fingerprint(Path(module_file))} {key}".encode()).hexdigest()[:16]
    path = CACHE_ROOT / "made" / f"{name}-{digest}.pickle"
    kept = _undamaged(path)
    if kept is not None:
        os.utime(path.parent)
        return pickle.loads(kept)
    made = make()
    path.parent.mkdir(exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}")
    data = pickle.dumps(made)
    partial.write_bytes(hashlib.sha256(data).digest() + data)
    partial.replace(path)
    return made


def _undamaged(path: Path) -> bytes | None:
    """What is behind the hash in a file of the cache; None where there is no such file, or another content."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    size = hashlib.sha256().digest_size
    return data[size:] if hashlib.sha256(data[size:]).digest() == data[:size] else None


def import_generated(name: str, source: str) -> ModuleType:
    """Import generated ``source`` as a module from a file in the cache, so that numba can cache it too.

    The file is named by the hash of its content; the same source is written once.
    """
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    module_name = f"firmware_sim_generated_{name}_{digest}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    path = CACHE_ROOT / "generated" / f"{module_name}.py"
    path.parent.mkdir(exist_ok=True)
    os.utime(path.parent)
    if not path.exists():
        partial = path.with_suffix(f".{os.getpid()}")
        partial.write_text(source)
        partial.replace(path)
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    spec.loader.exec_module(module)
    return module


def _leading_zeros(_typing_context: Any, _value: Any) -> Any:
    def lower(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctlz(arguments[0], false_bit)

    return numba.types.int64(numba.types.int64), lower


# Leading zero bits (0 to 64) of an int64, inside ``jit`` functions only: one machine instruction that LLVM has
# and numba does not offer.
leading_zeros: Any = intrinsic(_leading_zeros)

# What numba does not type.
_numba: Any = numba
_alloca_once: Any = alloca_once
carray: Any = _numba.carray


@intrinsic(prefer_literal=True)
def stack_space(_typing_context: Any, size: Any, zero: Any) -> Any:
    """A pointer to ``size`` (a literal) elements of the type of ``zero`` on the stack of the function that calls it.

    numba's own arrays are on the heap; to make and to count them took a third of the navigation solver's time.
    """
    if not isinstance(size, _numba.types.IntegerLiteral):
        return None
    element = _numba.types.unliteral(zero)

    def lower(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        return _alloca_once(builder, context.get_value_type(element), size=size.literal_value)

    return _numba.types.CPointer(element)(size, zero), lower
