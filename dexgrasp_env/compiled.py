"""The decorator of compiled functions: numba's, with the options that all of them share. It imports numba.

What is compiled is kept on disk, and a division by zero gives what numpy gives. A constant in a call between compiled
functions makes no version of its own, and no wrapper for C callbacks is made: neither is of use here, and both together
are a fifth of the compilation.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core import types
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])

stand_in: Callable[..., Any] | None = None
"""What a function becomes where it is not to be compiled, in the rehearsals of `dexgrasp.runs.compiling`."""


def njit(function: F, **options: Any) -> F:
    """Compile a function at its first call, for the types of its arguments.

    Args:
        function: of a module, found there by its name.
        **options: more of numba's.
    """
    if stand_in is not None:
        return cast(F, stand_in(function, **options))
    numbas: Any = numba.njit  # its stubs lack an option
    made = numbas(cache=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if isinstance(made, CPUDispatcher):  # not with NUMBA_DISABLE_JIT
        made.__class__ = _Kernel  # numba has no option for what it does
    return cast(F, made)


class _Kernel(CPUDispatcher):
    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call from a compiled function: a constant is a number like others."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), plain)
