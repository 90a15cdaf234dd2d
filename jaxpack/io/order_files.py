"""Orders of files as a distribution of instances, to evaluate on and to learn from."""

from dataclasses import replace

from jaxpack.errors import UserError
from jaxpack.io.jobs import read_job
from jaxpack.io.notes import Say, silent
from jaxpack.model.instances import Source
from jaxpack.model.orders import OrderFiles, Orders, bin_of, orders_of


def read_orders(files: OrderFiles, say: Say = silent) -> Orders:
    """The orders of a file, see `read_job`: those of a table by its column ORDER.

    Args:
        files: paths, and how to read them.
        say: takes a line for everything that was assumed, or is left out.

    Raises:
        UserError: naming what is wrong in a file.
    """
    jobs = read_job(files.orders, files.bins, ignore=files.ignore, by_order=True, say=say)
    kind = bin_of(jobs, files)
    kind = replace(kind, cost=None, tariff=None)
    alone = [replace(job, bins=(kind,), objective="bins") for job in jobs]
    orders = orders_of(alone, files)
    if missing := sum(job.count for job in jobs) - int((orders.goods.rows >= 0).sum()):
        say(f"{files.orders}: {missing:,} items that the bin cannot hold are left out")
    return orders


def read_again(source: Source) -> Source:
    """What a recipe is of, with its orders read again if it is of a file.

    Raises:
        UserError: where the file is gone or has changed.
    """
    if not isinstance(source, Orders):
        return source
    orders = read_orders(source.files)
    if orders != source:
        what = "not what they were: put them back, or begin another run"
        raise UserError(f"{source.files.orders}: the orders, or their bin, are {what}")
    return orders
