"""Functions that numba compiles, as functions of warp: one source for the processor and for a GPU."""

import ast
import functools
import inspect
import linecache
import math
import textwrap
from collections.abc import Callable
from typing import Any

from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks.records import EPISODE

with from_extra():
    import warp as wp


@functools.cache
def as_warp(function: Callable[..., Any]) -> Any:
    """Return a compiled function, and those that it calls, as a function of warp, whose numbers have 32 bits.

    A parameter of the type `Record` becomes two: a struct with an array (N, ...) for each field of `EPISODE`, numbers
    that are true or false among them, and the row. What else differs between the languages is rewritten; the source
    keeps to what both know: arrays are written number by number, and room for them has a constant size.

    Args:
        function: of a module, made by `compiled.njit`.
    """
    plain = inspect.unwrap(getattr(function, "py_func", function))
    tree = ast.parse(textwrap.dedent(inspect.getsource(plain)))
    _Translation().visit(tree)
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} & plain.__globals__.keys()
    namespace = {name: _translated(plain.__globals__[name]) for name in names}
    namespace |= {"__name__": plain.__module__, "wp": wp}
    source, file = ast.unparse(ast.fix_missing_locations(tree)), f"<warp: {plain.__qualname__}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)  # warp reads it there
    exec(compile(source, file, "exec"), namespace)
    made = namespace[plain.__name__]
    made.__annotations__ = dict.fromkeys(inspect.signature(made).parameters, Any)
    return wp.func(made)


def _translated(value: Any) -> Any:
    if value is math:
        return wp  # which names its functions alike
    return as_warp(value) if callable(value) else value


class _Translation(ast.NodeTransformer):
    """Makes the source of a compiled function that of one of warp."""

    _records: set[str]

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """A record is given as a struct and a row; decorators and types are numba's."""
        given_as = {given.arg: given.annotation for given in node.args.args}
        self._records = {name for name, kind in given_as.items() if kind and ast.unparse(kind) == "Record"}
        node.args.args = [ast.arg(name) for given in node.args.args for name in self._both(given.arg)]
        node.decorator_list, node.returns = [], None
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Room is made by warp; records are handed on as a struct and a row."""
        if ast.unparse(node.func) == "np.empty":
            return _parsed(f"wp.zeros(shape={ast.unparse(node.args[0])}, dtype=float)")
        node.args = [_parsed(part) for given in node.args for part in self._both(ast.unparse(given))]
        return self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """A field of a record is a row of an array; where it is true or false, a number that is read as such."""
        if not self._is_field(node):
            return node
        row = _parsed(f"{ast.unparse(node)}[{self._both(ast.unparse(node.value))[1]}]")
        truth = EPISODE[node.attr].kind == "b" and isinstance(node.ctx, ast.Load)
        return _parsed(f"{ast.unparse(row)} != 0") if truth else row

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """A quotient of whole numbers is no whole number."""
        self.generic_visit(node)
        if isinstance(node.op, ast.Div):
            node.left, node.right = _call("float", node.left), _call("float", node.right)
        return node

    def visit_Assign(self, node: ast.Assign) -> list[ast.stmt]:
        """One target a statement, and a number of the target's kind: constants are variables of a loop that way."""
        kinds = [self._kind(target, node.value) for target in node.targets]
        self.generic_visit(node)
        if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
            node.value.elts = [_call(_of_constant(value), value) for value in node.value.elts]
        return [
            ast.Assign([target], _call(kind, node.value))
            for target, kind in zip(node.targets, kinds, strict=True)
        ]

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST | list[ast.stmt]:
        """Rewrite updates of array elements as assignments of a number of the array's kind."""
        if isinstance(node.target, ast.Name):
            return self.generic_visit(node)
        now = _parsed(ast.unparse(node.target))
        return self.visit_Assign(ast.Assign([node.target], ast.BinOp(now, node.op, node.value)))

    def _both(self, name: str) -> list[str]:
        """Return what a name is called: of a record, the struct and the row."""
        return [name, f"{name}_row"] if name in self._records else [name]

    def _is_field(self, node: ast.AST) -> bool:
        return isinstance(node, ast.Attribute) and ast.unparse(node.value) in self._records

    def _kind(self, target: ast.expr, value: ast.expr) -> str:
        """Return the function that makes a value one for a target, empty for none."""
        if isinstance(target, ast.Name | ast.Tuple):
            return _of_constant(value)
        while isinstance(target, ast.Subscript) and not self._is_field(target):
            target = target.value
        if isinstance(target, ast.Attribute) and EPISODE[target.attr].base.kind != "f":
            return "int"
        return "float"


def _of_constant(value: ast.expr) -> str:
    if ast.unparse(value) in ("math.inf", "wp.inf"):
        return "float"
    return type(value.value).__name__ if isinstance(value, ast.Constant) else ""


def _call(function: str, value: ast.expr) -> ast.expr:
    return ast.Call(ast.Name(function), [value], []) if function else value


def _parsed(source: str) -> ast.expr:
    return ast.parse(source, mode="eval").body
