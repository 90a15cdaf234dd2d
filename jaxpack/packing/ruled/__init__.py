"""Rules of what lies where, one a file, for jobs that ask for more than `top_map` knows of."""

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.bases import Bases
from jaxpack.packing.ruled.door import Door
from jaxpack.packing.ruled.firm import Firm
from jaxpack.packing.ruled.gaps import Gaps
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.loads import Loads
from jaxpack.packing.ruled.stacks import Stacks
from jaxpack.packing.ruled.stops import Stops
from jaxpack.packing.ruled.support import Support

BOX_RULES: list[type[BoxRule]] = [Support, Bases, Gaps, Door, Stops, Stacks, Firm, Loads]
"""The cheap ones first: places that one refuses are not shown to the next."""


def asked_rules(loading: Loading) -> list[type[BoxRule]]:
    """Those that the job asks for."""
    return [rule for rule in BOX_RULES if rule.asked(loading)]
