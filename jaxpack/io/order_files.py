"""Orders of files as a distribution of instances, to evaluate on and to learn from."""

from dataclasses import replace

from jaxpack.errors import UserError
from jaxpack.io.jobs import read_job
from jaxpack.io.notes import Say, silent
from jaxpack.model.orders import OrderFiles, Orders, bin_of, orders_of


def read_orders(files: OrderFiles, digest: str = "", say: Say = silent) -> Orders:
    """The orders of a file, see `read_job`: those of a table by its column ORDER.

    Args:
        files: paths, and how to read them.
        digest: that the orders must have, if it is given.
        say: takes a line for everything that was assumed, or is left out.

    Raises:
        UserError: naming what is wrong in a file, or that it has changed.
    """
    jobs = read_job(files.orders, files.bins, ignore=files.ignore, by_order=True, say=say)
    kind = bin_of(jobs, files)
    alone = [replace(job, bins=(replace(kind, cost=None),), objective="bins") for job in jobs]
    orders = orders_of(alone, files)
    if digest and orders.digest != digest:
        what = "changed since: put back what it was, or begin anew"
        raise UserError(f"{files.orders}: the orders or their bin have {what}")
    if missing := sum(job.count for job in jobs) - int((orders.goods.rows >= 0).sum()):
        say(f"{files.orders}: {missing:,} items that the bin cannot hold are left out")
    return orders
