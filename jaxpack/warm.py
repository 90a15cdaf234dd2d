"""`python -m jaxpack.warm`: compiles ahead what `jaxpack solve` would compile when it meets orders.

Programs are compiled as the process of the search compiles them, and are then in the cache. That
all are there stands in a file beside them: to see it in the cache each would have to be traced.
"""

import hashlib
import os
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError, check_counts
from jaxpack.io.atomic import check_writable, replace_file
from jaxpack.plan_tables import Screen, counted, say
from jaxpack.xla.environment import cache_folder, compiler

KEPT = "warmed.txt"
"""The file in the cache: a line says for what, the others which programs."""
MOST = 1024  # items: what a policy draws has programs for no more


@dataclass(frozen=True)
class CommandOptions:
    """Compile once, after an install, what `solve` compiles otherwise when it meets an order."""

    dimension: Literal["2d", "3d", "both"] = "both"
    """Of the orders."""
    items: int = 128
    """For orders of so many items or fewer, up to 1024."""


def programs(options: CommandOptions) -> Iterator[tuple[str, Callable[[], None]]]:
    """(what it is for, what compiles it) of every program, the small ones of a kind first."""
    from jaxpack.io.weights import load_policy
    from jaxpack.search import packer, policy_orders
    from jaxpack.search.compiled import lanes_of
    from jaxpack.search.portfolio import policy_name

    for dimension in (2, 3) if options.dimension == "both" else (int(options.dimension[0]),):
        policy = load_policy(policy_name(dimension))
        for drawn in policy_orders.programs(dimension, options.items):
            yield str(drawn), partial(drawn.compile, policy)
        for packs in packer.programs(dimension == 2, options.items):
            yield str(packs), partial(packs.compile, lanes_of(packs.items))


def made_for() -> str:
    """What the programs of a cache depend on besides: the code, the compiler and the machine."""
    from jaxpack.xla.target import device_name

    known = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        known.update(path.read_bytes())
    known.update(repr((*compiler(), device_name())).encode())
    return known.hexdigest()


def prepare_folder(folder: Path) -> Path:
    """The file in the cache that says what is in it.

    Raises:
        UserError: nothing can be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_writable(folder / KEPT)
    except (UserError, OSError) as error:
        what = f"{folder}: programs cannot be kept there"
        raise UserError(f"{what}; name another folder as JAX_COMPILATION_CACHE_DIR") from error
    return folder / KEPT


def drop_cut_short(folder: Path) -> int:
    """Deletes programs that a process that ended was writing; JAX (0.10 to 0.12) never replaces
    them. How many there were.
    """
    dropped = 0
    for path in folder.glob("*-cache"):
        kept = path.read_bytes()
        try:
            if kept[:1] in (b"\x78", b""):  # or else compressed by something else than zlib
                zlib.decompress(kept)
        except zlib.error:
            path.unlink(missing_ok=True)
            dropped += 1
    return dropped


def compile_all(missing: dict[str, Callable[[], None]], tell: Callable[[str], None]) -> None:
    """Compiles programs on all cores, and says so of each; an interrupt leaves out the rest."""
    from jaxpack.xla.environment import usable_cores

    def timed(what: str) -> tuple[str, float]:
        begun = time.perf_counter()
        missing[what]()
        return what, time.perf_counter() - begun

    with ThreadPoolExecutor(usable_cores()) as threads:
        try:
            futures = [threads.submit(timed, what) for what in missing]
            for number, future in enumerate(as_completed(futures), 1):
                what, seconds = future.result()
                tell(f"{number}/{len(missing)}  {what}: {seconds:.1f} s")
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise


def main(argv: Sequence[str]) -> None:
    """Parses, compiles, prints."""
    options = parse_options(CommandOptions, "warm", argv)
    try:
        check_counts(options, "items", most=MOST)
    except UserError as error:
        raise UserError(f"--{error}") from None
    kept, begun = prepare_folder(cache_folder()), time.perf_counter()
    mine, wanted = made_for(), dict(programs(options))
    whole = not drop_cut_short(kept.parent)
    lines = kept.read_text(errors="replace").splitlines() if whole and kept.exists() else []
    there = lines[1:] if lines[:1] == [mine] else []
    missing = {what: some for what, some in wanted.items() if what not in there}
    compile_all(missing, partial(say, Screen(stderr=True)))
    with replace_file(kept) as file:
        file.write("\n".join([mine, *there, *missing, ""]))
    size = sum(entry.stat().st_size for entry in os.scandir(kept.parent))
    what = f"{counted(len(wanted), 'program')}, {len(wanted) - len(missing)} were there"
    seconds = time.perf_counter() - begun
    say(Screen(), f"{what}: {seconds:.1f} s; {kept.parent} has {size / 1e6:.1f} MB")


if __name__ == "__main__":
    run_door(main)
