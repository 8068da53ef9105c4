"""Stop a long loop in good order on SIGINT and SIGTERM."""

import signal
import threading
from contextlib import contextmanager


@contextmanager
def stop_on_signals():
    """Yield a function that tells whether SIGINT or SIGTERM has come; a second signal acts as it usually does.

    Outside the main thread, where Python takes no signals, it always tells no.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    came = []
    usual = {}

    def note(number, frame):
        came.append(number)
        restore()

    def restore():
        for number, handler in usual.items():
            signal.signal(number, handler)

    for number in (signal.SIGINT, signal.SIGTERM):
        usual[number] = signal.signal(number, note)
    try:
        yield lambda: bool(came)
    finally:
        restore()
