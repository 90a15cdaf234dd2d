"""What the parts of the search for a plan are worth, each with equally many packings.

python experiments/parts.py [--data FOLDER]     (8 minutes on one core)

2D: of Berkey and Wang's and Martello and Vigo's classes the first instances of 60 items. 3D: every
fourth one of Ivancic's. Seed 0, more than half of a base supported. Writes results/parts.csv and
prints a table: the bins in all, and the cost, in which a packing counts by how near it is to a bin
less. The policy's 64 orders come on top.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from public_instances import (
    BERKEY_WANG,
    IVANCIC,
    add_data_option,
    data_file,
    read_2bp,
    read_ivancic,
)
from rows import RESULTS, write_rows

from jaxpack.cli import prepare_jax
from jaxpack.io.weights import load_policy
from jaxpack.learning.recipe import Policy
from jaxpack.learning.rollout import LANES as DRAWN
from jaxpack.model.encoding import Genes, load_job
from jaxpack.model.job import Job
from jaxpack.search.compiled import EXCHANGE, HEAT, LANES, ROUNDS, first_genes, packer_of
from jaxpack.search.local_search import Lanes, Step, advance, annealed, bred, exchange, join, packed
from jaxpack.search.policy_orders import policy_genes

DISPATCHES = {2: 40, 3: 12}  # of LANES * ROUNDS packings
PARTS = {
    "annealing": ((annealed,), False, False),
    "genetic algorithm": ((bred,), False, False),
    "in turns": ((bred, annealed), False, False),
    "in turns, with exchange": ((bred, annealed), True, False),
    "and the policy's orders": ((bred, annealed), True, True),
}
"""Who searches; whether they exchange their best; whether the policy's orders are there."""


def instances(data: Path) -> Iterator[Job]:
    for job, known in read_2bp(data_file(data, BERKEY_WANG)):
        if (known["n"], known["id"]) == (60, 1):
            yield job
    yield from read_ivancic(data_file(data, IVANCIC))[::4]


def search(job: Job, policy: Policy | None, how: tuple[Step, ...], sharing: bool) -> Lanes:
    """The lanes at the end; their best is the best of all."""
    loading = load_job(job)
    packer, stock = packer_of(loading)

    def some(genes: Genes, first: int) -> Lanes:
        mine = Genes(*(leaf[first : first + LANES] for leaf in genes))
        return packed(packer, np.random.default_rng([0, 0]), mine)

    sorts = first_genes(loading, stock, 0, DRAWN)
    lanes = some(sorts, 0)
    if policy:
        genes = policy_genes(loading, stock, sorts, policy, 0)
        for first in range(0, len(genes.order), LANES):
            lanes = join(lanes, some(genes, first))
    islands = [lanes._replace(random=np.random.default_rng([0, 1 + n])) for n in range(len(how))]
    dispatches = DISPATCHES[job.dimension]
    for turn in range(dispatches):
        which = turn % len(how)
        heat = HEAT * (1 - turn / dispatches) ** 2
        islands[which] = advance(packer, stock, islands[which], how[which], ROUNDS, heat)
        if sharing and (turn + 1) % EXCHANGE == 0:
            islands = list(exchange(*islands))
    return min(islands, key=lambda lanes: lanes.best.cost)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    options = parser.parse_args()
    prepare_jax()
    rows = []
    for job in instances(options.data):
        for name, (how, sharing, drawing) in PARTS.items():
            policy = load_policy(f"bin-aware-{job.dimension}d-turned") if drawing else None
            best = search(job, policy, how, sharing).best
            bins = len(set(best.bin.tolist()) - {-1})
            rows.append(
                {"dimension": job.dimension, "instance": job.name, "parts": name, "bins": bins}
                | {"cost": round(best.cost, 3)}
            )
        print(job.name, [row["bins"] for row in rows[-len(PARTS) :]], flush=True)
        write_rows(RESULTS / "parts.csv", rows)
    for dimension in DISPATCHES:
        for name in PARTS:
            ours = [r for r in rows if (r["dimension"], r["parts"]) == (dimension, name)]
            bins, cost = (sum(row[key] for row in ours) for key in ("bins", "cost"))
            print(f"| {dimension}D, {len(ours)} instances | {name} | {bins} | {cost:.2f} |")


if __name__ == "__main__":
    main()
