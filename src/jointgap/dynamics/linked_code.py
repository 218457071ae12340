"""Functions that compiled code calls: linked into their callers, not compiled for themselves as well.

By itself numba optimises every function with all that it calls, makes machine code of it and two wrappers besides,
which Python may call, before its caller does the same again: of a chain of calls n deep the innermost function n times.
Here a function that is called from compiled code is typed and lowered once, and what Python calls is optimised as one.
"""

from collections.abc import Callable

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

AVAILABLE = numba.version_info.short == (0, 68)
"""Whether this numba's insides are those that this file was written for; with others all is compiled as numba does."""


class _LinkedCode(JITCodeLibrary):
    """Code for linking: cleaned function by function, but neither optimised as a whole nor made native."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _ToLink(Compiler):
    def define_pipelines(self):
        self.state.flags.no_compile = True
        self.state.library = _LinkedCode(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _Part(CPUDispatcher):
    """A function as compiled code calls it; its libraries stand in for the entry points that it lacks."""

    def add_overload(self, cres) -> None:
        self.overloads[tuple(cres.signature.args)] = cres
        self.targetctx.insert_user_function(cres.library, cres.fndesc, [cres.library])

    def get_overload(self, sig):
        return self.overloads[tuple(sig)].library


def linked_where_called(dispatcher: Dispatcher) -> Callable:
    """`dispatcher`, which compiled code from now on calls in its linked form, and Python as ever."""
    if AVAILABLE:
        options = dispatcher.targetoptions | _NO_WRAPPERS
        part = _Part(dispatcher.py_func, targetoptions=options, pipeline_class=_ToLink)
        dispatcher.get_call_template, dispatcher.get_overload = part.get_call_template, part.get_overload
    return dispatcher
