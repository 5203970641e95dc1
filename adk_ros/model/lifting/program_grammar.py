# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check a TorchScript program from a model folder before PyTorch reads it.

TorchScript can write files, map memory and loop for ever, and a class may run code while it is
loaded. An encoder needs none of this. The archive is therefore bounded in size, and its code must
consist of functions and `forward` methods of assignments, branches and the operators below. What
such a program computes is bounded by `program_cost`.
"""

from __future__ import annotations

import ast
from typing import NamedTuple

from adk_ros.errors import UsageError
from adk_ros.model.lifting.program_archive import TRUST, read_entries, unreadable, write_archive
from adk_ros.model.lifting.program_data import check_data

PRODUCTS = frozenset({"addmm", "linear", "matmul", "mm"})
JOINING = frozenset({"cat"})
SELECTING = frozenset({"slice"})
ELEMENTWISE = frozenset({
    "abs", "add", "clamp", "cos", "div", "elu", "exp", "gelu", "leaky_relu", "maximum", "minimum",
    "mul", "neg", "reciprocal", "relu", "rsub", "sigmoid", "silu", "sin", "softplus", "sqrt",
    "sub", "tanh",
})  # fmt: skip
OPERATORS = PRODUCTS | JOINING | SELECTING | ELEMENTWISE
"""Operators of `torch` that an encoder may call; `program_cost` knows the shapes they return."""
_METHODS = {"forward", "__len__"}
_STATEMENTS = (ast.Assign, ast.AnnAssign, ast.Return, ast.If, ast.Pass)
_EXPRESSIONS = (
    ast.Attribute, ast.BinOp, ast.BoolOp, ast.Call, ast.Compare, ast.Constant, ast.List,
    ast.Load, ast.Name, ast.Store, ast.Tuple, ast.UnaryOp, ast.boolop, ast.cmpop, ast.operator,
    ast.unaryop,
)  # fmt: skip
_FUNCTIONS = {"annotate", "bool", "float", "getattr", "int"}


class CheckedProgram(NamedTuple):
    """A program to load, and its functions by qualified name; `forward` by that of its class."""

    archive: bytes
    functions: dict[str, ast.FunctionDef]


def check_program(program: bytes) -> CheckedProgram:
    """
    Return the program as an archive of checked entries, and its functions.

    :raises UsageError: it is too large, no TorchScript archive, or does what no encoder needs.
    """
    entries = read_entries(program)
    functions: dict[str, ast.FunctionDef] = {}
    for module, source in entries.sources.items():
        try:
            tree = ast.parse(source)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise unreadable(error) from None
        functions |= _functions(module, tree)
    check_data(entries)
    return CheckedProgram(write_archive(entries), functions)


def _refused(what: str) -> UsageError:
    return UsageError(f"the encoder {what}, which no encoder needs: {TRUST}")


def _functions(module: str, tree: ast.Module) -> dict[str, ast.FunctionDef]:
    """Return the functions of a module, and the `forward` methods of its classes."""
    found = {}
    for item in tree.body:
        if isinstance(item, ast.FunctionDef) and not item.decorator_list:
            for statement in item.body:
                _check(statement)
            found[f"{module}.{item.name}"] = item
            continue
        if not isinstance(item, ast.ClassDef):
            raise _refused(f"has code outside of classes ({type(item).__name__})")
        for part in item.body:
            if isinstance(part, ast.FunctionDef):
                if part.name not in _METHODS or part.decorator_list:
                    raise _refused(f"has a method '{part.name}'")
                for statement in part.body:
                    _check(statement)
                if part.name == "forward":
                    found[f"{module}.{item.name}"] = part
            elif not isinstance(part, ast.Assign | ast.AnnAssign):
                raise _refused(f"has a class with {type(part).__name__}")
    return found


def _check(statement: ast.stmt) -> None:
    """Refuse a statement that is not a plain computation."""
    if isinstance(statement, ast.Expr):
        # A call for its effect: name the function that is called.
        _check_expression(statement.value)
    if not isinstance(statement, _STATEMENTS):
        raise _refused(f"has a {type(statement).__name__} statement")
    if isinstance(statement, ast.If):
        for part in (*statement.body, *statement.orelse):
            _check(part)
        _check_expression(statement.test)
        return
    if isinstance(statement, ast.Assign | ast.Return | ast.AnnAssign) and statement.value:
        _check_expression(statement.value)


def _check_expression(expression: ast.expr) -> None:
    for node in ast.walk(expression):
        if isinstance(node, ast.Call):
            _check_call(node)
        elif not isinstance(node, _EXPRESSIONS):
            raise _refused(f"has a {type(node).__name__} expression")


def _check_call(call: ast.Call) -> None:
    function = call.func
    if isinstance(function, ast.Attribute):
        owner = function.value
        if isinstance(owner, ast.Name) and owner.id == "torch" and operator(call) in OPERATORS:
            return
        if ast.unparse(function).startswith("__torch__."):
            # A function of the program; `program_cost` refuses others.
            return
        if function.attr == "forward" and not _is_namespace(owner):
            return
    elif isinstance(function, ast.Name) and function.id in _FUNCTIONS:
        return
    raise _refused(f"calls '{ast.unparse(function)}'")


def operator(call: ast.Call) -> str:
    """Return the operator of a call `torch.operator(...)`; one that works in place is the same."""
    function = call.func
    return function.attr.removesuffix("_") if isinstance(function, ast.Attribute) else ""


def _is_namespace(owner: ast.expr) -> bool:
    return isinstance(owner, ast.Name) and owner.id in {"torch", "ops"}
