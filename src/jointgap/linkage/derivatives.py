"""Exact derivatives of a calculation's nodes."""

from collections.abc import Iterable, Sequence

from jointgap.linkage.machine_code import Graph, Number, Symbol, needed


def derivatives(
    graph: Graph, results: Sequence[Number], loads: Iterable[Number]
) -> list[list[Number]]:
    """Derivatives of each result by each of the `loads`, as further nodes of the graph.

    A result that does not depend on a load has the derivative 0.0. Terms are shared with the
    results and with each other.
    """
    roots = [graph.index(result) for result in results]
    order = needed(graph, roots)
    by_load = [_by(graph, order, graph.index(load)) for load in loads]
    return [[slopes.get(root, 0.0) for slopes in by_load] for root in roots]


def _by(graph: Graph, order: Sequence[int], load: int) -> dict[int, Number]:
    """Derivatives by one load of the nodes that depend on it."""
    slopes: dict[int, Number] = {load: 1.0}
    for node in order:
        operation, *operands = graph.nodes[node]
        if operation in ("load", "number") or not slopes.keys() & {*operands}:
            continue
        own, values = Symbol(graph, node), [Symbol(graph, each) for each in operands]
        inner = [slopes.get(each, 0.0) for each in operands]
        slopes[node] = _chained(graph, operation, own, values, inner)
    return slopes


def _chained(
    graph: Graph, operation: str, own: Symbol, values: list[Symbol], slopes: list[Number]
) -> Number:
    """Derivative of a node from those of its operands."""
    match operation:
        case "add":
            return slopes[0] + slopes[1]
        case "sub":
            return slopes[0] - slopes[1]
        case "mul":
            return slopes[0] * values[1] + values[0] * slopes[1]
        case "div":
            return (slopes[0] - own * slopes[1]) * (1.0 / values[1])
        case "neg":
            return -slopes[0]
        case "sqrt":
            return slopes[0] * (0.5 / own)
        case "atan2":
            square = values[0] * values[0] + values[1] * values[1]
            return (slopes[0] * values[1] - slopes[1] * values[0]) / square
    cosine, sine = graph.cos_sin(values[0])
    return slopes[0] * cosine if operation == "sin" else -(slopes[0] * sine)
