# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check the attributes of a TorchScript program's modules before PyTorch reads them.

They are a pickle with tensors in separate entries. PyTorch's reader, in C++, does not check that
a tensor lies within its storage: a damaged file then reads or crashes beyond it. The operations of
the pickle are therefore first run here, on objects that do nothing, and only those that PyTorch
writes are known.
"""

from __future__ import annotations

import pickletools
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.model.lifting.program_archive import TRUST, ProgramEntries, unreadable

_MAX_MEMO = 1 << 16
_MAX_DIMENSIONS = 8
_ITEM_BYTES = {
    "DoubleStorage": 8, "FloatStorage": 4, "HalfStorage": 2, "LongStorage": 8, "IntStorage": 4,
    "ShortStorage": 2, "CharStorage": 1, "ByteStorage": 1, "BoolStorage": 1,
}  # fmt: skip
"""Bytes of an element by type of storage."""


_VALUES = {
    "BINUNICODE", "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "GLOBAL",
}  # fmt: skip
"""Operations that put their argument on the stack; a class or function as "module name"."""
_CONSTANTS = {"NEWTRUE": True, "NEWFALSE": False, "NONE": None, "EMPTY_TUPLE": ()}
_LENGTHS = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_REBUILD, _HOOKS = "torch._utils _rebuild_tensor_v2", "collections OrderedDict"


class _Module:
    """Stands for an object of one of the program's classes; its attributes are `state`."""

    state: dict[str, Any] | None = None


class _Storage:
    """Stands for a storage of `numel` elements that its entry has room for."""

    def __init__(self, numel: int) -> None:
        self.numel = numel


class _Tensor:
    """Stands for a tensor that lies within its storage."""


def check_data(entries: ProgramEntries) -> None:
    """
    Check the attributes of the modules: numbers, texts, and tensors within their storages.

    :raises UsageError: they are damaged, or hold what no encoder needs.
    """
    root = _read(entries.data, entries.storages)
    if not isinstance(root, _Module):
        raise _damaged("they are not those of a module")
    _check_module(root)
    if _read(entries.constants, {}) != ():
        raise UsageError(f"the encoder has constant tensors, which no encoder needs: {TRUST}")


def _check_module(root: _Module) -> None:
    seen: set[int] = set()
    waiting = [root]
    while waiting:
        module = waiting.pop()
        # A module may be an attribute of several others, and even of itself.
        if id(module) in seen:
            continue
        seen.add(id(module))
        if type(module.state) is not dict or not all(type(key) is str for key in module.state):
            raise _damaged("a module has none")
        for name, value in module.state.items():
            if isinstance(value, _Module):
                waiting.append(value)
            elif not isinstance(value, _Tensor | bool | int | float | str | None):
                raise UsageError(
                    f"the encoder's attribute '{name}' is neither a tensor nor a number: {TRUST}"
                )


def _read(data: bytes, storages: dict[str, bytes]) -> Any:
    """Return what a pickle describes, of the classes above."""
    machine, end = _Machine(storages), -1
    try:
        for operation, argument, place in pickletools.genops(data):
            machine.run(operation.name, argument)
            end = 0 if place is None else place
        if end != len(data) - 1:
            raise _damaged("something follows them")
        (root,) = machine.stack
    except UsageError:
        raise
    except Exception as error:
        # A damaged pickle raises whatever its operations meet.
        raise unreadable(error) from None
    return root


class _Machine:
    """Runs the operations of a pickle."""

    def __init__(self, storages: dict[str, bytes]) -> None:
        self.stack: list[Any] = []
        self._marks: list[int] = []
        self._memo: dict[int, Any] = {}
        self._storages = storages

    def run(self, name: str, argument: Any) -> None:
        """Run an operation."""
        stack = self.stack
        if name in _VALUES:
            stack.append(argument)
        elif name in _CONSTANTS:
            stack.append(_CONSTANTS[name])
        elif name == "EMPTY_DICT":
            stack.append({})
        elif name == "MARK":
            self._marks.append(len(stack))
        elif name == "TUPLE":
            stack.append(tuple(self._popped(self._marks.pop())))
        elif name in _LENGTHS:
            stack.append(tuple(self._popped(len(stack) - _LENGTHS[name])))
        elif name in {"SETITEM", "SETITEMS"}:
            self._set_items(len(stack) - 2 if name == "SETITEM" else self._marks.pop())
        elif name in {"BINPUT", "LONG_BINPUT"}:
            if argument >= _MAX_MEMO:
                raise _damaged("they refer to an object that is not there")
            self._memo[argument] = stack[-1]
        elif name in {"BINGET", "LONG_BINGET"}:
            stack.append(self._memo[argument])
        elif name == "BINPERSID":
            stack.append(self._storage(*stack.pop()))
        elif name == "BUILD":
            # A copy, as PyTorch makes: the mapping could be changed afterwards.
            state = dict(stack.pop())
            if stack[-1].state is not None:
                raise ValueError("attributes are given twice")
            stack[-1].state = state
        elif name in {"NEWOBJ", "REDUCE"}:
            arguments = stack.pop()
            stack.append(_made(name, stack.pop(), arguments))
        elif name not in {"PROTO", "STOP"}:
            raise _damaged(f"they contain the operation {name}")

    def _popped(self, start: int) -> list[Any]:
        if start < 0:
            raise ValueError("a tuple has too few items")
        items = self.stack[start:]
        del self.stack[start:]
        return items

    def _set_items(self, start: int) -> None:
        items = self._popped(start)
        if type(self.stack[-1]) is not dict or len(items) % 2:
            raise ValueError("items without a mapping")
        self.stack[-1].update(zip(items[::2], items[1::2], strict=True))

    def _storage(self, kind: str, storage: str, key: str, device: str, numel: int) -> _Storage:
        """Return a storage, after comparing its size with that of its entry."""
        namespace, _, name = str(storage).partition(" ")
        if kind != "storage" or namespace != "torch" or device != "cpu":
            raise ValueError("a storage is not described as one")
        if name not in _ITEM_BYTES:
            raise _foreign(storage)
        if type(numel) is not int or numel * _ITEM_BYTES[name] != len(self._storages[key]):
            raise ValueError(f"storage {key} does not have the size that it should have")
        return _Storage(numel)


def _made(operation: str, function: Any, arguments: Any) -> Any:
    """Return a new object, or a function's result."""
    if type(arguments) is not tuple:
        raise ValueError("a call has no arguments")
    if operation == "REDUCE" and function == _REBUILD:
        return _tensor(*arguments)
    if operation == "REDUCE" and function == _HOOKS and arguments == ():
        return {}
    if (
        operation == "NEWOBJ"
        and arguments == ()
        and str(function).startswith("__torch__.")
        and "torch.classes" not in function
    ):
        return _Module()
    raise _foreign(function)


def _foreign(name: Any) -> UsageError:
    found = str(name).replace(" ", ".")
    return UsageError(f"the encoder contains '{found}', which no encoder needs: {TRUST}")


def _tensor(
    storage: _Storage, offset: int, size: tuple[int, ...], stride: tuple[int, ...],
    requires_grad: bool, hooks: dict[Any, Any], *rest: Any,
) -> _Tensor:  # fmt: skip
    """Return a tensor, as `torch._utils._rebuild_tensor_v2` would."""
    numbers = (offset, *size, *stride)
    if not isinstance(storage, _Storage) or type(size) is not tuple or type(stride) is not tuple:
        raise ValueError("a tensor has no storage, size or stride")
    if not all(type(number) is int and number >= 0 for number in numbers):
        raise ValueError("a tensor's offset, size or stride is no number")
    if len(size) != len(stride) or len(size) > _MAX_DIMENSIONS:
        raise ValueError("a tensor's size and stride do not fit")
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if offset > storage.numel or (0 not in size and last >= storage.numel):
        raise ValueError("a tensor is larger than its storage")
    if type(requires_grad) is not bool or hooks != {} or rest:
        raise ValueError("a tensor has hooks")
    return _Tensor()


def _damaged(reason: str) -> UsageError:
    return UsageError(f"the encoder's attributes are damaged ({reason}): train again")
