"""More effort never makes a search worse: after every round, at small and odd settings too."""

import itertools

import jax
import numpy as np
import pytest
from cases import packer

from jaxpack.errors import UserError
from jaxpack.learning.presets import PAPER_2D
from jaxpack.methods import SEARCHES, MethodOptions, make_method
from jaxpack.model.instances import Distribution, sample
from jaxpack.model.metrics import bins_first_cost, paper_cost
from jaxpack.search.bin_by_bin import bin_by_bin, orders_found
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import genetic
from jaxpack.search.evolved import evolved
from jaxpack.search.heuristics import height_order, random_order
from jaxpack.search.protocol import run_rounds
from jaxpack.search.sampling import best_of, sampling

COUNT, ITEMS, ROUNDS = 64, 12, 6
INSTANCES = sample(PAPER_2D, Distribution(ITEMS, 1, 5), jax.random.key(1), COUNT)
INSTANCES = INSTANCES._replace(mask=INSTANCES.mask.at[::2, :4].set(False))
KEYS = jax.random.split(jax.random.key(2), COUNT)
DRAW = jax.vmap(random_order)
OBJECTIVES = {"bins": bins_first_cost, "paper": paper_cost}


def heights(keys, instances):
    return jax.vmap(height_order)(instances)


def by_bins(width, draws, objective=bins_first_cost):
    return bin_by_bin(PAPER_2D, heights, DRAW, objective, width, draws)


def bred(population, objective=bins_first_cost, seeds=None, **shares):
    return genetic(PAPER_2D, BrkgaConfig(population, **shares), objective, seeds)


def with_bred(population, width, generations, objective=bins_first_cost, **shares):
    breeding = bred(population, objective, **shares)
    search = by_bins(width, 2, objective)
    return evolved(PAPER_2D, search, orders_found, breeding, objective, generations)


def sampled_seeds(keys, instances):
    """More than the smallest populations take."""
    split = jax.vmap(lambda key: jax.random.split(key, 5))(keys)
    return jax.vmap(lambda one: DRAW(one, instances), 1, 1)(split)


def costs_of(objective, orders):
    orders = np.asarray(orders)
    assert (np.sort(orders, 1) == np.arange(ITEMS)).all()
    packings = packer(PAPER_2D)(INSTANCES, orders)
    return np.asarray(jax.jit(jax.vmap(objective))(INSTANCES, packings))


def never_worse(search, objective=bins_first_cost):
    """Whether something was found at all, at no time worse than before."""
    state = jax.jit(search.start)(KEYS, INSTANCES)
    advance, best = jax.jit(search.advance), jax.jit(search.best)
    refine = jax.jit(search.refine) if search.refine else advance
    first = before = costs_of(objective, best(state))
    for turn in range(ROUNDS):
        state = (refine if turn % 3 == 2 else advance)(INSTANCES, state)
        after = costs_of(objective, best(state))
        worse = (after > before + 1e-6).sum()
        assert worse == 0, f"{worse} of {COUNT} instances are worse after round {turn + 1}"
        before = after
    return (before < first).any()


@pytest.mark.parametrize(
    "search",
    [
        sampling(PAPER_2D, DRAW, bins_first_cost, 1),
        bred(3, seeds=sampled_seeds),
        by_bins(1, 1),
        with_bred(5, 4, 1),
        *(
            pytest.param(search, marks=pytest.mark.slow)
            for search in (
                sampling(PAPER_2D, DRAW, bins_first_cost, 3, samples=7),
                bred(2, elite=0.5, mutants=0.0),
                bred(5, bias=0.0),
                bred(6, elite=0.7, mutants=0.0, bias=0.9, seeds=sampled_seeds),
                by_bins(5, 2),
                *(with_bred(population, 4, 1) for population in (3, 4, 6, 7)),
                with_bred(2, 1, 3, elite=0.5, mutants=0.0),
                with_bred(5, 8, 0),
            )
        ),
    ],
)
def test_no_round_of_a_search_makes_it_worse(search):
    assert never_worse(search)


@pytest.mark.slow
@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("population", [3, 5, 9, 10])
@pytest.mark.parametrize("name", SEARCHES)
def test_no_round_of_a_named_search_makes_it_worse(name, population, objective):
    config = BrkgaConfig(population)
    options = MethodOptions(
        objective=objective, brkga=config, kinds=ITEMS, width=8, draws=1, breeding=2
    )
    never_worse(make_method(name, PAPER_2D, options).search, OBJECTIVES[objective])


@pytest.mark.slow
def test_the_paper_cost_gets_no_worse_either():
    assert never_worse(with_bred(5, 4, 2, paper_cost), paper_cost)


def test_more_samples_are_never_worse():
    found = [
        costs_of(bins_first_cost, jax.jit(search)(KEYS, INSTANCES))
        for search in (
            lambda keys, instances, count=count: best_of(
                PAPER_2D, keys, instances, DRAW, count, bins_first_cost, chunk=4
            )
            for count in (1, 3, 4, 9)
        )
    ]
    assert all((after <= before).all() for before, after in itertools.pairwise(found))


def test_no_rounds_are_an_answer_too():
    order = run_rounds(sampling(PAPER_2D, DRAW, bins_first_cost, 3), KEYS, INSTANCES, 0)
    assert (costs_of(bins_first_cost, order) < ITEMS).all()


def test_a_search_of_nothing_is_refused():
    for width, draws in ((0, 1), (1, 0)):
        with pytest.raises(UserError, match="at least 1"):
            by_bins(width, draws)
    with pytest.raises(UserError, match="at least 1"):
        sampling(PAPER_2D, DRAW, bins_first_cost, 0)
