"""Derivatives of the nodes are those of the equations."""

import ctypes
import math

import numpy as np
import pytest

from jointgap.linkage.compiled import Kind, build_variant
from jointgap.linkage.derivatives import derivatives
from jointgap.linkage.machine_code import Code, Graph, MachineCode, Store, Symbol
from tests.linkage.cases import LINKAGES, loosened
from tests.linkage.test_compiled import drawn

LOOSE = {name: ("piston_pin", "B", "D", "F") for name in LINKAGES}


def whole(variant):
    """The three functions as one without intermediate memory."""
    stores = [s for name in variant.codes for s in variant.codes[name].stores if s.name != "kept"]
    return Code(variant.codes["pose"].graph, tuple(stores))


def memory_of(variant, linkage, generator):
    *_, given = drawn(linkage, variant.kind, generator)
    memory = {name: each.copy() for name, each in variant.fields(variant.memory(linkage)).items()}
    for name, values in given.items():
        memory[name][:] = values
    return memory


def complex_slopes(code, memory, field, index):
    """Derivatives by one load, from a complex step."""
    step = 1e-30
    shifted = {name: each.astype(complex) for name, each in memory.items()}
    shifted[field][index] += 1j * step
    code.run(shifted)
    return np.array([shifted[s.name][s.index].imag / step for s in code.stores])


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name", LINKAGES)
def test_derivatives_by_parameters_and_states_agree_with_complex_steps(name, is_free):
    linkage, generator = loosened(LINKAGES[name], LOOSE[name]), np.random.default_rng(3)
    variant = build_variant(linkage, [1.0] * len(linkage.dyads), Kind(is_free))
    code, memory = whole(variant), memory_of(variant, linkage, generator)
    loads = [(f, i) for f in ("parameters", "state") for i in range(variant.sizes[f])]
    results = [Symbol(code.graph, store.node) for store in code.stores]
    slopes = derivatives(code.graph, results, [code.graph.load(*load) for load in loads])
    rows = [(i, j) for i in range(len(results)) for j in range(len(loads))]
    stores = [Store("slopes", n, code.graph.index(slopes[i][j])) for n, (i, j) in enumerate(rows)]
    chained = Code(code.graph, tuple(stores))
    memory["slopes"] = np.zeros(len(rows))
    chained.run(memory)
    found = memory["slopes"].reshape(len(results), len(loads))
    expected = np.transpose([complex_slopes(code, memory, *load) for load in loads])
    sizes = np.abs(expected).max(axis=0, initial=1e-300)
    assert np.max(np.abs(found - expected) / sizes) < 1e-9
    assert np.max(np.abs(by_machine_code(chained, memory) - memory["slopes"])) < 1e-9 * sizes.max()


def by_machine_code(code, memory):
    """What the machine code of a function writes to the field `slopes`."""
    ends = np.cumsum([0, *(each.size for each in memory.values())])
    begin = dict(zip(memory, map(int, ends), strict=False))
    joined = np.concatenate([*memory.values()])
    joined[begin["slopes"] :] = 0.0
    built = MachineCode({"slopes": code}, begin)
    ctypes.CFUNCTYPE(None, ctypes.c_int64)(built.addresses["slopes"])(joined.ctypes.data)
    return joined[begin["slopes"] :]


def test_structural_zeros_vanish_and_terms_are_shared():
    graph = Graph()
    a, b, c = (graph.load("values", i) for i in range(3))
    product = a * b
    [[by_a, by_b, by_c]] = derivatives(graph, [product + graph.root(product)], [a, b, c])
    assert by_c == 0.0
    count = len(graph.nodes)
    again = derivatives(graph, [product + graph.root(product)], [a, b, c])
    assert [each.index for each in again[0][:2]] == [by_a.index, by_b.index]
    assert len(graph.nodes) == count


@pytest.mark.parametrize("at", [0.4, 2.9])
def test_every_operation_has_its_derivative(at):
    graph = Graph()
    x = graph.load("values", 0)
    cosine, sine = graph.cos_sin(x)
    result = (graph.root(x) - 1.0) / (x * x + 2.0) - (-cosine) * sine
    [[slope]] = derivatives(graph, [result], [x])
    memory = {"values": [np.array([at])], "slope": [None]}
    Code(graph, (Store("slope", 0, graph.index(slope)),)).run(memory)
    root = math.sqrt(at)
    expected = 0.5 / root / (at * at + 2) - 2 * at * (root - 1) / (at * at + 2) ** 2
    assert memory["slope"][0] == pytest.approx(expected + math.cos(2 * at), rel=1e-13)
