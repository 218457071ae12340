"""From arithmetic in plain Python to machine code.

A function of symbols leaves a list of additions, products, quotients and roots, from which LLVM
makes a function of memory. It has no branches and no loops, and knows nothing of mechanisms.
"""

from collections.abc import Callable, Iterable, Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from llvmlite import binding, ir

_OPERANDS = {"add": 2, "sub": 2, "mul": 2, "div": 2, "atan2": 2}
_OPERANDS |= {"neg": 1, "sqrt": 1, "sin": 1, "cos": 1}

_PYTHON: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": np.divide,
    "neg": lambda a: -a,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "atan2": np.arctan2,
}


@dataclass
class Graph:
    """Nodes of a calculation, each once: an operation with its operands, a constant, or a value in
    memory."""

    nodes: list[tuple] = field(default_factory=list)
    _known: dict[tuple, int] = field(default_factory=dict)

    def node(self, *key: Any) -> int:
        """Index of a node."""
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(key)
        return self._known[key]

    def load(self, name: str, index: int) -> "Symbol":
        """A number of a field in memory."""
        return Symbol(self, self.node("load", name, index))

    def root(self, value: "Number") -> "Number":
        return Symbol(self, self.node("sqrt", self.index(value)))

    def cos_sin(self, value: "Number") -> tuple["Number", "Number"]:
        return tuple(Symbol(self, self.node(name, self.index(value))) for name in ("cos", "sin"))

    def angle(self, direction: tuple["Number", "Number"]) -> "Number":
        """Angle [rad] of a vector."""
        x, y = map(self.index, direction)
        return Symbol(self, self.node("atan2", y, x))

    def index(self, value: "Number") -> int:
        """Index of the node of a symbol or constant."""
        return value.index if isinstance(value, Symbol) else self.node("number", float(value))


class Symbol:
    """A number that is known when the code runs."""

    __slots__ = ("graph", "index")

    def __init__(self, graph: Graph, index: int):
        self.graph, self.index = graph, index

    def _of(self, operation: str, one: "Number", other: "Number") -> "Symbol":
        operands = [self.graph.index(one), self.graph.index(other)]
        if operation in ("add", "mul"):
            operands.sort()
        return Symbol(self.graph, self.graph.node(operation, *operands))

    def __add__(self, other: "Number") -> "Number":
        return self if _is(other, 0.0) else self._of("add", self, other)

    __radd__ = __add__

    def __sub__(self, other: "Number") -> "Number":
        return self if _is(other, 0.0) else self._of("sub", self, other)

    def __rsub__(self, other: "Number") -> "Number":
        return -self if _is(other, 0.0) else self._of("sub", other, self)

    def __mul__(self, other: "Number") -> "Number":
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        return -self if _is(other, -1.0) else self._of("mul", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: "Number") -> "Number":
        return self._of("div", self, other)

    def __rtruediv__(self, other: "Number") -> "Number":
        return 0.0 if _is(other, 0.0) else self._of("div", other, self)

    def __neg__(self) -> "Number":
        operation, *operands = self.graph.nodes[self.index]
        if operation == "neg":
            return Symbol(self.graph, operands[0])
        return Symbol(self.graph, self.graph.node("neg", self.index))


Number = float | Symbol


def _is(value: Number, constant: float) -> bool:
    return not isinstance(value, Symbol) and value == constant


@dataclass(frozen=True)
class Store:
    """A result that goes to memory."""

    name: str  # Of the field
    index: int
    node: int


def needed(graph: Graph, roots: Iterable[int], known: Iterable[int] = ()) -> list[int]:
    """The nodes that `roots` need, in order; those of `known` nodes excluded."""
    known, found, left = {*known}, set(), [*roots]
    while left:
        node = left.pop()
        if node not in found:
            found.add(node)
            if node not in known:
                operation, *operands = graph.nodes[node]
                left += operands[: _OPERANDS.get(operation, 0)]
    return sorted(found)


def kept(graph: Graph, first: Sequence[Store], second: Sequence[Store]) -> list[int]:
    """Nodes of the `first` function that the `second` uses directly: kept in memory."""
    one = needed(graph, [store.node for store in first])
    two = needed(graph, [store.node for store in second])
    shared = {node for node in {*one} & {*two} if graph.nodes[node][0] in _OPERANDS}
    users = {store.node for store in second}
    for node in {*two} - {*one}:
        operation, *operands = graph.nodes[node]
        users |= {*operands[: _OPERANDS.get(operation, 0)]}
    return sorted(shared & users)


@dataclass(frozen=True)
class Code:
    """A function of memory as nodes: what it stores, and what an earlier function has kept."""

    graph: Graph
    stores: tuple[Store, ...]
    kept: Mapping[int, int] = field(default_factory=dict)  # Place of a node in the field `kept`

    @cached_property
    def _order(self) -> list[int]:
        return needed(self.graph, [store.node for store in self.stores], self.kept)

    @np.errstate(invalid="ignore", divide="ignore")
    def run(self, memory: Mapping[str, MutableSequence]) -> None:
        """Run in Python, on numbers or on arrays."""
        values: dict[int, np.ndarray | float] = {}
        for node in self._order:
            operation, *operands = self.graph.nodes[node]
            if node in self.kept:
                values[node] = memory["kept"][self.kept[node]]
            elif operation == "load":
                values[node] = memory[operands[0]][operands[1]]
            elif operation == "number":
                values[node] = operands[0]
            else:
                values[node] = _PYTHON[operation](*(values[operand] for operand in operands))
        for store in self.stores:
            memory[store.name][store.index] = values[store.node]

    def build(self, module: ir.Module, name: str, begin: Mapping[str, int]) -> None:
        """Add the function to an LLVM module: it gets the address of the memory, in which the
        fields `begin` at these numbers."""
        word, number = ir.IntType(64), ir.DoubleType()
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), [word]), name)
        builder = ir.IRBuilder(function.append_basic_block())
        base = builder.inttoptr(function.args[0], number.as_pointer())

        def place(field_name: str, index: int) -> ir.Value:
            offset = ir.Constant(word, begin[field_name] + index)
            return builder.gep(base, [offset], inbounds=True)

        # products may be contracted into sums; nothing else changes the order of the operations
        flags, values = ("contract",), {}
        two = {"add": builder.fadd, "sub": builder.fsub, "mul": builder.fmul, "div": builder.fdiv}
        for node in self._order:
            operation, *operands = self.graph.nodes[node]
            if node in self.kept:
                values[node] = builder.load(place("kept", self.kept[node]))
            elif operation == "load":
                values[node] = builder.load(place(*operands))
            elif operation == "number":
                values[node] = ir.Constant(number, operands[0])
            elif operation == "neg":
                values[node] = builder.fneg(values[operands[0]], flags=flags)
            elif operation in two:
                values[node] = two[operation](*(values[each] for each in operands), flags=flags)
            else:
                count = _OPERANDS[operation]
                called = module.globals.get(operation) or (
                    module.declare_intrinsic(f"llvm.{operation}", [number])
                    if count == 1
                    else ir.Function(module, ir.FunctionType(number, [number] * count), operation)
                )
                values[node] = builder.call(called, [values[each] for each in operands])
        for store in self.stores:
            builder.store(values[store.node], place(store.name, store.index))
        builder.ret_void()


class MachineCode:
    """Compiled functions: their addresses by name. The code lives as long as this object."""

    def __init__(self, codes: Mapping[str, Code], begin: Mapping[str, int]):
        module = ir.Module()
        for name, code in codes.items():
            code.build(module, name, begin)
        parsed = binding.parse_assembly(str(module))
        parsed.verify()
        self._engine = binding.create_mcjit_compiler(parsed, _target_machine())
        self._engine.finalize_object()
        self.addresses = {name: self._engine.get_function_address(name) for name in codes}


@cache
def _initialised() -> None:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()


def _target_machine() -> binding.TargetMachine:
    """That of this processor; each compiler owns its own."""
    _initialised()
    return binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(),
        features=binding.get_host_cpu_features().flatten(),
        opt=3,
        jit=True,
    )
