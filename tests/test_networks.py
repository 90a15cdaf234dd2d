"""One interface for every network: what all of them do, and one that the package has not."""

import json
from dataclasses import asdict, dataclass, field, replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import TINY, packer

from jaxpack import (
    MethodOptions,
    Policy,
    TrainConfig,
    UserError,
    load_policy,
    make_method,
    preset,
    save_policy,
)
from jaxpack.io.configs import config_from_dict, config_to_dict
from jaxpack.learning.losses import Outcome
from jaxpack.learning.networks import NETWORKS
from jaxpack.learning.trainer import init_state, train_chunk
from jaxpack.model.instances import Distribution, sample
from jaxpack.model.packing_check import check_packings
from jaxpack.packing.env import Decisions
from jaxpack.packing.first_fit import pack_decisions

SMALL = {"pointer": {"hidden": 8, "critic": 4}, "bin-aware": {"hidden": 8}}


def waves(leaf):
    """Weights that are far from those that choose nothing."""
    return jnp.cos(3 * jnp.arange(leaf.size, dtype=float)).reshape(leaf.shape)


@pytest.mark.parametrize("name", NETWORKS)
def test_what_a_network_decides_is_what_is_packed(name):
    problem, network = TINY.problem, NETWORKS[name](**SMALL[name])
    params = jax.tree.map(waves, network.init(problem, jax.random.key(0)))
    instances = sample(problem, Distribution(10, 1, 4, "all"), jax.random.key(1), 6)
    keys = jax.random.split(jax.random.key(2), 6)
    made = {
        "greedy": network.orders(problem, params, instances),
        "sampled": network.orders(problem, params, instances, keys),
        "hot": network.orders(problem, params, instances, keys, temperature=50.0),
    }
    if "beam-N" in network.searches:
        beams = network.beams(problem, params, instances, 3)
        first, made["beam"] = (jax.tree.map(lambda leaf, i=i: leaf[:, i], beams) for i in (0, 2))
        jax.tree.map(np.testing.assert_array_equal, first, made["greedy"])
    else:
        with pytest.raises(UserError, match="has no beam search"):
            network.beams(problem, params, instances, 3)
    for how, decided in made.items():
        turned, packing = pack_decisions(problem, instances, decided)
        check_packings(problem, turned, decided.order, packing, how)
        assert (decided.orientation > 0).any() == (name == "bin-aware"), how
    assert (made["sampled"].order != made["greedy"].order).any()
    assert (made["sampled"].order != made["hot"].order).any()


@dataclass(frozen=True)
class Weighted:
    """A network from outside: it sorts by a weighted sum of the sides."""

    hidden: int = 3
    name: str = field(default="weighted", init=False)
    searches: ClassVar = ("best-of-N", "search")

    def learners(self, objective):
        return ("leave-one-out",)

    def init(self, problem, key):
        return {"weights": jax.random.normal(key, (self.hidden,))}

    def orders(self, problem, params, instances, keys=None, kinds=None, temperature=None):
        scores = instances.size @ params["weights"]
        if keys is not None:
            scores += jax.vmap(lambda key: jax.random.gumbel(key, scores.shape[1:]))(keys)
        scores = jnp.where(instances.mask, scores, -jnp.inf)
        order = jnp.argsort(-scores, axis=1).astype(jnp.int32)
        return Decisions(order, jnp.zeros_like(order))

    def beams(self, problem, params, instances, width, kinds=None):
        raise UserError("the weighted network has no beam search")

    def gradient(self, config, params, instances, keys):
        return params, Outcome(*[jnp.float32(1)] * 7)


def test_a_network_from_outside_is_one_class_and_one_entry(monkeypatch, tmp_path):
    monkeypatch.setitem(NETWORKS, "weighted", Weighted)
    config = replace(TINY, policy=Weighted(), learner="leave-one-out", samples=2)
    again = config_from_dict(TrainConfig, json.loads(json.dumps(config_to_dict(config))))
    assert again == config
    start = init_state(config, jax.random.key(0))
    before = np.asarray(start.params["weights"])
    state, metrics = train_chunk(config, start, 2)
    assert metrics.finite == 1
    assert (np.asarray(state.params["weights"]) != before).all()
    save_policy(tmp_path / "mine.npz", Policy(config, state.params), {})
    policy = load_policy(str(tmp_path / "mine.npz"))
    assert policy.config == config
    instances = sample(config.problem, config.distribution, jax.random.key(1), 4)
    keys = jax.random.split(jax.random.key(2), 4)
    options = MethodOptions(policy=policy, width=2, draws=2, rounds=1, breeding=0)
    for name in ("weighted", "weighted-best-of-3", "weighted-search"):
        orders = make_method(name, config.problem, options).orders(keys, instances)
        check_packings(config.problem, instances, orders, packer(config.problem)(instances, orders))
    with pytest.raises(UserError, match=r"choose from random, .* weighted-best-of-N"):
        make_method("weighted-beam-3", config.problem, options)
    with pytest.raises(UserError, match="those that the weighted network has"):
        replace(config, learner="self-label")


def as_version_01_wrote_it(name):
    """A preset's recipe in the words of then: options apart that were not free of each other."""
    written = json.loads(json.dumps(asdict(preset(name))))
    del written["policy"]["name"]
    if written["policy"].pop("sees", ""):
        written["policy"] |= {"placement": True, "surroundings": True, "stock": True}
    by_bin = written["learner"] == "leave-one-out-by-bin"
    written["credit"] = "bin" if by_bin else "order"
    if by_bin:
        written["learner"] = "leave-one-out"
    return written


@pytest.mark.parametrize("name", ["paper-2d", "bin-aware-2d-turned", "bin-aware-3d-turned"])
def test_recipes_of_version_01_are_read(name):
    assert config_from_dict(TrainConfig, as_version_01_wrote_it(name)) == preset(name)


def test_what_a_policy_saw_in_version_01_is_one_word_now():
    written = as_version_01_wrote_it("bin-aware-2d-turned")
    for saw, sees in (
        ({}, "surroundings"),
        ({"stock": True, "surroundings": False}, "stock"),
        ({"surroundings": False}, "placement"),
        ({"placement": False, "surroundings": False, "stock": False}, "sizes"),
    ):
        written["policy"] = {"hidden": 8, "attention": 2} | saw
        policy = config_from_dict(TrainConfig, written).policy
        assert policy == NETWORKS["bin-aware"](hidden=8, attention=2, sees=sees)


def test_recipes_of_version_01_that_were_none_are_not_read():
    written = as_version_01_wrote_it("bin-aware-3d-turned")
    for change, message in (
        ({"learner": "self-label"}, "option 'credit' is unknown"),
        ({"credit": "luck"}, "option 'credit' is unknown"),
        ({"policy": {"name": "luck"}}, "there is no network 'luck': choose pointer or bin-aware"),
        ({"policy": {"name": ["pointer"]}}, "there is no network "),
        ({"policy": {"placement": False, "stock": True}}, "option 'placement' is unknown"),
        ({"policy": {"placement": [], "stock": {}}}, "option 'placement' is unknown"),
        ({"policy": 7}, "expected a table of options"),
    ):
        with pytest.raises(UserError, match=message):
            config_from_dict(TrainConfig, written | change)
