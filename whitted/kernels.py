"""How long Dr.Jit's kernels take."""

import drjit as dr


def timed(function, *arguments):
    """Call ``function(*arguments)`` and wait for all that it has computed.

    Returns:
        What it returns, evaluated, and the seconds that all kernels took meanwhile, compilation left out.
    """
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        found = function(*arguments)
        dr.eval(found)
        dr.sync_thread()
        return found, sum(kernel["execution_time"] for kernel in dr.kernel_history()) / 1000
