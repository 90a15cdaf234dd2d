from dataclasses import dataclass

from jaxpack.loading.figures import cost_bound, lower_bound, total_cost


@dataclass(frozen=True)
class Bounds:
    bins: int
    cost: float

    def reached_by(self, job, plan):
        if plan.left_out:
            return False
        if job.priced:
            return total_cost(job, plan) <= self.cost * (1 + 1e-9)
        return len(plan.bins) <= self.bins and len({k.size for k in job.bins}) == 1


def bounds(job, seconds=None):
    return Bounds(lower_bound(job), cost_bound(job))
