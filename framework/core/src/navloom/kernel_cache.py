"""numba's kernel cache on disk, made safe for a robot: a kernel compiles and runs whatever is wrong with the cache.

numba trusts its cache files. After a power cut they may be torn; a torn index or kernel fails to load, or loads as
corrupt machine code. A full disk or a read-only folder fails the call that compiles. Here each file ends in a checksum
over its contents, and each kernel names the signature it was compiled for. A kernel whose file does not match is
compiled again and its file replaced; an unusable cache is skipped.

It also makes kernels cheaper to compile, see `_compile_less`: the first run of a robot compiles for most of a minute.

Files keep the names and layout of numba's own. numba can read them and ignores the checksum. Files written by numba
have no checksum, so their kernels are compiled again, once.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import logging
import pickle
import sys
import uuid
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numba

from navloom.kernel_progress import Kernels, kernels_so_far

__all__ = ["harden_kernel_cache", "tell_compiled"]

caching: Any = import_module("numba.core.caching")
dispatcher: Any = import_module("numba.core.dispatcher")
dumps: Any = import_module("numba.core.serialize").dumps
CHECKSUM = hashlib.sha256().digest_size
"""Size of the checksum at the end of each file, bytes."""


class CheckedFiles:
    """The index of a function's kernels and one file per kernel: numba's IndexDataCacheFile, with checks.

    Args:
        cache_path: Folder of the files.
        filename_base: Common start of the file names.
        source_stamp: Stamp of the function's source; kernels with another stamp are out of date.
    """

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        self._folder, self._base, self._stamp = Path(cache_path), filename_base, source_stamp
        self._index = self._folder / f"{filename_base}.nbi"

    def flush(self) -> None:
        """Forget every kernel."""
        self._save_index({})

    def load(self, key: Any) -> Any:
        """The kernel of a signature, or None if there is no undamaged one."""
        name = self._load_index().get(key)
        if name is None:
            return None
        content = _read_checked(self._folder / name)
        if content is None:
            return None
        kernel, signature = pickle.load(content), pickle.load(content)
        # Two processes that save at once may give one name to two signatures.
        return kernel if signature == key else None

    def save(self, key: Any, data: Any) -> None:
        """Store the kernel of a signature."""
        names = self._load_index()
        if key not in names:
            taken = set(names.values())
            numbered = (f"{self._base}.{number}.nbc" for number in itertools.count(1))
            names[key] = next(name for name in numbered if name not in taken)
            self._save_index(names)
        _write_checked(self._folder / names[key], dumps(data) + dumps(key))

    def _load_index(self) -> dict[Any, str]:
        content = _read_checked(self._index)
        try:
            if content is None or pickle.load(content) != numba.__version__:
                return {}
            stamp, names = pickle.load(content)
        except Exception:  # the file is undamaged, but names something that is no longer installed
            return {}
        return names if stamp == self._stamp else {}

    def _save_index(self, names: dict[Any, str]) -> None:
        _write_checked(self._index, pickle.dumps(numba.__version__) + dumps((self._stamp, names)))


def _read_checked(path: Path) -> io.BytesIO | None:
    """Contents of a file without its checksum; None if it is missing, damaged or unreadable."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    body, checksum = data[:-CHECKSUM], data[-CHECKSUM:]
    return io.BytesIO(body) if hashlib.sha256(body).digest() == checksum else None


def _write_checked(path: Path, body: bytes) -> None:
    draft = path.with_name(f"{path.name}.tmp.{uuid.uuid4().hex[:16]}")
    try:
        draft.write_bytes(body + hashlib.sha256(body).digest())
        # Other processes load the same file at any time.
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def harden_kernel_cache() -> None:
    """Make every kernel cache of this process safe, those of plugins included. Further calls do nothing.

    Call it before anything compiles: before the framework's kernels, and before a plugin of a role is imported.
    """
    cache = caching.Cache
    if caching.IndexDataCacheFile is CheckedFiles:
        return
    caching.IndexDataCacheFile = CheckedFiles
    init, load, save = cache.__init__, cache.load_overload, cache.save_overload

    def tolerant_init(self: Any, function: Any) -> None:
        try:
            init(self, function)
        except Exception as error:  # no writable folder, or unreadable source
            self._cache_path, self._enabled = None, False
            _tell_once(error)

    def tolerant_load(self: Any, signature: Any, context: Any) -> Any:
        try:
            return load(self, signature, context)
        except Exception:  # the file is undamaged, but does not match what is installed now
            return None

    def tolerant_save(self: Any, signature: Any, kernel: Any) -> None:
        _count_compiled()
        try:
            save(self, signature, kernel)
        except Exception as error:
            _tell_once(error, self._cache_path)

    cache.__init__, cache.load_overload, cache.save_overload = tolerant_init, tolerant_load, tolerant_save
    _compile_less()


def _compile_less() -> None:
    """Compile no wrapper for C around the kernels of numba and navloom, which is a tenth of the work.

    Only a kernel that is passed to another kernel as an argument needs one. Strangers' kernels keep theirs.
    """
    compiler = dispatcher._FunctionCompiler
    customize = compiler._customize_flags

    def without_c_wrapper(self: Any, flags: Any) -> Any:
        if self.py_func.__module__.partition(".")[0].partition("_")[0] in ("numba", "navloom"):
            flags.no_cfunc_wrapper = True
        return customize(self, flags)

    compiler._customize_flags = without_c_wrapper


_compiled = 0
_listener: Callable[[Kernels], None] | None = None


def tell_compiled(listener: Callable[[Kernels], None] | None) -> None:
    """Call a function with the kernels of this process after each that it compiles; None ends that."""
    global _listener
    _listener = listener


def _count_compiled() -> None:
    global _compiled
    _compiled += 1
    if _listener is not None:
        _listener(kernels_so_far(_compiled))


_told: set[str] = set()


def _tell_once(error: Exception, folder: str | None = None) -> None:
    """Warn that kernels are not cached, once for each reason."""
    why = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
    if why in _told or sys.stderr is None:
        return
    _told.add(why)
    where = f"the kernel cache {folder} cannot be written" if folder else "there is no folder for the kernel cache"
    text = f"{where}: {why}; kernels are compiled, and again at the next start"
    logging.getLogger("navloom.kernel_cache").warning(text)
