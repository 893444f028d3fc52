"""Where the command `nico-selfmodel` begins."""

import atexit
import gc
import os


def main() -> None:
    """Run the command line."""
    # At its end Python looks through all there is for what refers to itself, as if its memory were
    # needed again, which takes a twentieth of a calibration and more of a report.
    atexit.register(gc.freeze)
    # Two BLAS threads make small problems several times slower; BLAS reads this when it is loaded.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # OpenCV's own lines say nothing that ours do not; it reads this when it is loaded.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    from nico_selfmodel.cli.interruption import hear_signals, say_stopped, was_stopped
    from nico_selfmodel.freed_memory import keep_freed_memory

    try:
        hear_signals()
        keep_freed_memory()
        from nico_selfmodel.cli.app import run

        run()
    except SystemExit:
        raise
    except BaseException as error:
        if not was_stopped(error):
            raise
        raise SystemExit(say_stopped()) from None
