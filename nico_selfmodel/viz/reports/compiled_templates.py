"""Templates as Python compiled them, kept as it keeps its own modules: in `__pycache__`.

What report.html.j2 and its parts compile to takes a twentieth of `calibrate stereo`.
"""

import sys
from importlib.util import cache_from_source
from pathlib import Path

from jinja2 import BytecodeCache
from jinja2.bccache import Bucket

from nico_selfmodel.files.whole import write_bytes_whole

_TEMPLATES = Path(__file__).parent / "templates"


class CompiledTemplates(BytecodeCache):
    """Reads and writes the bytecode of templates, where that can be; they compile without it."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Fill in what an earlier run compiled of the same text by the same Python and jinja."""
        try:
            bucket.bytecode_from_string(_path_of(bucket).read_bytes())
        except (OSError, EOFError, ValueError, TypeError):
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep what was compiled, unless Python keeps nothing or the folder is read-only."""
        if sys.dont_write_bytecode:
            return
        path = _path_of(bucket)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes_whole(path, bucket.bytecode_to_string())
        except OSError:
            return


def _path_of(bucket: Bucket) -> Path:
    return Path(cache_from_source(str(_TEMPLATES / f"{bucket.key}.py")))
