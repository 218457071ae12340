"""Operators of the genetic algorithm as pure functions of arrays and a random generator.

They follow the MATLAB toolbox that the paper used, in its variants for linear inequalities: what they make of allowed
parents is allowed.

- Fitness by rank: expectation proportional to 1/sqrt(rank).
- Stochastic uniform selection (Baker 1987): one throw, equal steps along a line on which each parent has its
  expectation's length.
- Crossover: a random point of the line between two parents (the toolbox's "intermediate"; its default "scattered" would
  swap L2 and L3 between parents and can break the inequality).
- Mutation: a step in a random direction, cut where it would leave the region. Its length is drawn evenly up to the
  width of the box in every generation. The toolbox's "adaptive feasible" mutation shrinks it after failures instead, and
  then far more runs end somewhere on the valley's floor.
"""

import numpy as np

from jointgap.optimise.region import Region


def rank_expectation(values: np.ndarray) -> np.ndarray:
    """How much of the next parents each individual should be, from values to minimise; shape (n,), sum 1."""
    rank = np.empty(len(values))
    rank[np.argsort(values, kind="stable")] = np.arange(1, len(values) + 1)
    weight = 1.0 / np.sqrt(rank)
    return weight / np.sum(weight)


def stochastic_uniform(expectation: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Indices of `count` parents, shape (count,), shuffled.

    Parent i is taken floor(count * expectation[i]) times or once more.

    Parameters
    ----------
    expectation : ndarray, shape (n,)
        Shares of the parents, sum 1.
    count : int
    random : Generator
    """
    marks = (np.arange(count) + random.random()) / count
    edges = np.cumsum(expectation)
    edges[-1] = 1.0
    return random.permutation(np.searchsorted(edges, marks, side="right"))


def intermediate_crossover(first: np.ndarray, second: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A random point between each pair of parents, shapes (n, 2).

    Parameters
    ----------
    first, second : ndarray, shape (n, 2)
        Parents (L2, L3) [m].
    random : Generator
    """
    return first + random.random((len(first), 1)) * (second - first)


def feasible_mutation(parents: np.ndarray, region: Region, random: np.random.Generator) -> np.ndarray:
    """Each parent (n, 2) moved by up to the box's width in a random direction, cut at the region's edge.

    Parameters
    ----------
    parents : ndarray, shape (n, 2)
        (L2, L3) [m].
    region : Region
    random : Generator
    """
    angle = 2.0 * np.pi * random.random(len(parents))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moves = random.random((len(parents), 1)) * direction * region.size
    moved = [parent + region.reach(parent, move) * move for parent, move in zip(parents, moves, strict=True)]
    return np.clip(moved, region.lower, region.upper)
