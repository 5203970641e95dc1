# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bound the memory and time of a checked TorchScript program without running it.

The methods that `program_grammar` returns are interpreted with shapes in place of tensors. They
have no loops, and their operators allocate nothing but their result, so the sizes of all results
bound the cost of a call.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.lifting.program_grammar import JOINING, PRODUCTS, SELECTING, operator

_MAX_ELEMENTS = 1 << 20
"""Elements of a result, 4 MB: those of the default model have at most 1224."""
_MAX_OPERATIONS = 500
_MAX_MULTIPLICATIONS = 1 << 26
"""Multiplications in a call, some 10 ms: the default model has 5000."""


@dataclass(frozen=True)
class _Shape:
    """The shape of a tensor."""

    sizes: tuple[int, ...]

    @property
    def elements(self) -> int:
        return int(np.prod(self.sizes, dtype=np.float64))


def check_cost(module: Any, functions: dict[str, ast.FunctionDef], n_in: int) -> None:
    """
    Check what a call with one row of `n_in` values computes.

    :param module: the loaded program. :param functions: as `check_program` returns them.
    :raises UsageError: it needs too much memory or time, or does not accept such a row.
    """
    interpreter = _Interpreter(functions)
    # A small file can contain a large tensor whose elements share their memory.
    for tensor in module.state_dict().values():
        interpreter.spend(tensor.numel())
    try:
        interpreter.call(module, [_Shape((1, n_in))])
    except UsageError:
        raise
    except Exception as error:
        # Shapes that do not fit, missing attributes, unbound names: whatever a program may have.
        last = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        raise UsageError(f"the encoder does not accept {n_in} inputs: {last}") from None


class _Interpreter:
    """Runs `forward` methods on shapes and adds up what they cost."""

    def __init__(self, functions: dict[str, ast.FunctionDef]) -> None:
        self._functions = functions
        self._operations = self._multiplications = 0

    def call(self, module: Any, arguments: list[Any]) -> Any:
        """Return the result of a module's `forward`."""
        return self._apply(self._functions[str(module._c.qualified_name)], [module, *arguments])

    def _apply(self, function: ast.FunctionDef, arguments: list[Any]) -> Any:
        self.spend()
        names = [argument.arg for argument in function.args.args]
        defaults = [self._value(item, {}) for item in function.args.defaults]
        missing = len(names) - len(arguments)
        if not 0 <= missing <= len(defaults):
            raise TypeError(f"{function.name} does not take {len(arguments)} arguments")
        given = [*arguments, *defaults[len(defaults) - missing :]]
        returned, result = self._run(function.body, dict(zip(names, given, strict=True)))
        if not returned:
            raise TypeError(f"{function.name} returns nothing")
        return result

    def spend(self, elements: int = 0, multiplications: int = 0) -> None:
        """Account for an operation and its result; refuse a program that costs too much."""
        self._operations += 1
        self._multiplications += multiplications
        if (
            self._operations > _MAX_OPERATIONS
            or elements > _MAX_ELEMENTS
            or self._multiplications > _MAX_MULTIPLICATIONS
        ):
            raise UsageError(
                "the encoder computes more than one for 40 predictions a second can: load only "
                "models that you trust, or train one"
            )

    def _run(self, body: list[ast.stmt], variables: dict[str, Any]) -> tuple[bool, Any]:
        """Run statements; return whether one of them returned, and what."""
        for statement in body:
            if isinstance(statement, ast.Return):
                return True, self._value(statement.value, variables)
            if isinstance(statement, ast.If):
                taken = self._value(statement.test, variables)
                if isinstance(taken, _Shape):
                    raise TypeError("a branch depends on the input")
                branch = statement.body if taken else statement.orelse
                returned, result = self._run(branch, variables)
                if returned:
                    return True, result
            elif isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
                variables[statement.targets[0].id] = self._value(statement.value, variables)
            elif not isinstance(statement, ast.Pass):
                raise TypeError(f"{type(statement).__name__} is not supported")
        return False, None

    def _value(self, node: ast.expr | None, variables: dict[str, Any]) -> Any:
        """Return the value of an expression, of a tensor its shape."""
        if node is None:
            return None
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            return variables[node.id]
        if isinstance(node, ast.List | ast.Tuple):
            return [self._value(item, variables) for item in node.elts]
        if isinstance(node, ast.Attribute):
            return self._attribute(self._value(node.value, variables), node.attr)
        if isinstance(node, ast.UnaryOp):
            operand = self._value(node.operand, variables)
            return not operand if isinstance(node.op, ast.Not) else -operand
        if isinstance(node, ast.Call):
            return self._called(node, variables)
        raise TypeError(f"{type(node).__name__} is not supported")

    def _attribute(self, owner: Any, name: str) -> Any:
        found = getattr(owner, name)
        sizes = getattr(found, "shape", None)
        if sizes is None:
            return found
        shape = _Shape(tuple(sizes))
        self.spend(shape.elements)
        return shape

    def _called(self, node: ast.Call, variables: dict[str, Any]) -> Any:
        function = node.func
        if isinstance(function, ast.Name):
            # annotate(type, value), int(value) and the like; getattr(owner, name).
            if function.id == "getattr":
                owner, name = (self._value(item, variables) for item in node.args)
                return self._attribute(owner, str(name))
            return self._value(node.args[-1], variables)
        assert isinstance(function, ast.Attribute)
        arguments = [self._value(item, variables) for item in node.args]
        arguments += [self._value(item.value, variables) for item in node.keywords]
        if function.attr == "forward":
            return self.call(self._value(function.value, variables), arguments)
        name = ast.unparse(function)
        if name.startswith("__torch__."):
            return self._apply(self._functions[name], arguments)
        result, inner = _result(operator(node), arguments)
        self.spend(result.elements, result.elements * inner)
        return result


def _result(name: str, arguments: list[Any]) -> tuple[_Shape, int]:
    """Return the shape of an operator's result, and multiplications per element."""
    shapes = [argument.sizes for argument in arguments if isinstance(argument, _Shape)]
    if name in JOINING:
        parts = [part.sizes for part in arguments[0]]
        dim = int(arguments[1]) if len(arguments) > 1 else 0
        sizes = list(parts[0])
        sizes[dim] = sum(part[dim] for part in parts)
        return _Shape(tuple(sizes)), 0
    if name in SELECTING:
        # slice(a, dim, start, end, step), each but the first with a default
        sizes = list(shapes[0])
        given = (*arguments[1:], *(0, None, None, 1)[len(arguments) - 1 :])
        dim, start, end, step = given
        sizes[dim] = len(range(sizes[dim])[start:end:step])
        return _Shape(tuple(sizes)), 0
    if name in PRODUCTS:
        # addmm(c, a, b) = c + a b, linear(a, b, c) = a b' + c
        left, right = shapes[1:3] if name == "addmm" else shapes[:2]
        if name == "linear":
            right = right[::-1]
        if len(left) != 2 or len(right) != 2 or left[1] != right[0]:
            raise TypeError(f"shapes {left} and {right} cannot be multiplied")
        product = (left[0], right[1])
        others = shapes[:1] if name == "addmm" else shapes[2:]
        return _Shape(np.broadcast_shapes(product, *others)), left[1]
    return _Shape(np.broadcast_shapes(*shapes)), 1
