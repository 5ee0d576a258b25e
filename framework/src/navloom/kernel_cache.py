"""numba's kernel cache on disk, made safe for a robot: whatever is wrong with it, a kernel compiles and runs.

numba trusts its cache files. After a power cut they may be torn, and a torn index or kernel fails to load, or loads
as machine code that nobody compiled; a full disk or a folder that cannot be written fails the call that compiles. Here
each file ends in a checksum over all of it, and each kernel names the signature it was compiled for. A file that does
not fit is compiled again and replaced; a cache that cannot be used is done without.

Files keep the names and the order of numba's own, which reads them and ignores what follows; numba's own have no
checksum, so they are compiled again, once.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import logging
import pickle
import sys
import uuid
from importlib import import_module
from pathlib import Path
from typing import Any

import numba

__all__ = ["harden_kernel_cache"]

caching: Any = import_module("numba.core.caching")
dumps: Any = import_module("numba.core.serialize").dumps
CHECKSUM = hashlib.sha256().digest_size
"""Bytes at the end of each file."""


class CheckedFiles:
    """The index of a function's kernels and a file for each of them: numba's IndexDataCacheFile, with checks.

    Args:
        cache_path: Folder.
        filename_base: Of all its files.
        source_stamp: Of the function's source; kernels of another one are out of date.
    """

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        self._folder, self._base, self._stamp = Path(cache_path), filename_base, source_stamp
        self._index = self._folder / f"{filename_base}.nbi"

    def flush(self) -> None:
        """Forget every kernel."""
        self._save_index({})

    def load(self, key: Any) -> Any:
        """The kernel of a signature, or None where there is none that is whole."""
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
        """Keep the kernel of a signature."""
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
        except Exception:  # it was whole, and names what is not installed any more
            return {}
        return names if stamp == self._stamp else {}

    def _save_index(self, names: dict[Any, str]) -> None:
        _write_checked(self._index, pickle.dumps(numba.__version__) + dumps((self._stamp, names)))


def _read_checked(path: Path) -> io.BytesIO | None:
    """A file less its checksum; None where it is missing, damaged or unreadable."""
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
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def harden_kernel_cache() -> None:
    """Make every kernel cache of this process safe, of plugins too; once is enough.

    Called before anything compiles: by what compiles the framework's kernels, and before a role's plugin is imported.
    """
    cache = caching.Cache
    if caching.IndexDataCacheFile is CheckedFiles:
        return
    caching.IndexDataCacheFile = CheckedFiles
    init, load, save = cache.__init__, cache.load_overload, cache.save_overload

    def tolerant_init(self: Any, function: Any) -> None:
        try:
            init(self, function)
        except Exception as error:  # no folder can be written, or the source cannot be read
            self._cache_path, self._enabled = None, False
            _tell_once(error)

    def tolerant_load(self: Any, signature: Any, context: Any) -> Any:
        try:
            return load(self, signature, context)
        except Exception:  # it was whole, and does not fit what is installed now
            return None

    def tolerant_save(self: Any, signature: Any, kernel: Any) -> None:
        try:
            save(self, signature, kernel)
        except Exception as error:
            _tell_once(error, self._cache_path)

    cache.__init__, cache.load_overload, cache.save_overload = tolerant_init, tolerant_load, tolerant_save


_told: set[str] = set()


def _tell_once(error: Exception, folder: str | None = None) -> None:
    """Say on standard error that kernels are not kept, once for each reason."""
    why = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
    if why in _told or sys.stderr is None:
        return
    _told.add(why)
    where = f"the kernel cache {folder} cannot be written" if folder else "there is no folder for the kernel cache"
    text = f"{where}: {why}; kernels are compiled, and again at the next start"
    logging.getLogger("navloom.kernel_cache").warning(text)
