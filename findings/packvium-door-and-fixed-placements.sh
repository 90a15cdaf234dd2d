#!/usr/bin/env bash
# `access_directions` of a container do not hold for `fixed_placements`. In a van with a door at +x an item
# of the second stop stands before one of the first; that is admitted and "optimal", without a warning.
# `packvium.validate` refuses the same result: the first item cannot be unloaded. The same two items on
# top of each other are refused as they should be, and so is what stands in the way in a search.
# packvium 1.8.0. One would have guessed that a record of what is on board is held against all rules
# of the request, or none: "a fixed set that is not a valid packing on its own is refused".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet packvium==1.8.0 > /dev/null 2>&1
cat > "$folder/show.py" << 'PYTHON'
from importlib.metadata import version

from packvium import InvalidRequestError, pack_from_dict, validate


def sides(*lengths):
    return dict(zip(("length", "width", "height"), map(str, lengths)))


def request(room, **later):
    """Two items that fill a van, the one of the later stop at that place; a search without one."""
    cube, names = sides(100, 100, 100), ("first", "later")
    items = [{"id": name, "dimensions": cube, "stop_index": n} for n, name in enumerate(names)]
    van = {"id": "van", "inner_dimensions": sides(*room), "access_directions": ["+x"]}
    place = {"container_type": "van", "orientation": "LWH"}
    fixed = [place | {"item_type": "first"}, place | {"item_type": "later", "position": later}]
    asked = {"items": items, "containers": [van]}
    return asked | {"fixed_placements": fixed} if later else asked


def told(asked):
    try:
        result = pack_from_dict(asked)
    except InvalidRequestError as error:
        return error.detail.split(":")[0], [], []
    puts = result["containers"][0]["placements"]
    at = {put["item_id"]: put["position"]["x"]["value"] for put in puts}
    return result["status"], result["warnings"], [one.code for one in validate(asked, result)], at


before = told(request((200, 100, 100), x="100"))
above = told(request((100, 100, 200), z="100"))
free = told(request((200, 100, 100)))
print("packvium", version("packvium"))
print("fixed, the later one before the first: ", before)
print("fixed, the later one on the first:     ", above)
print("where the search puts them:            ", free)
assert before[:3] == ("optimal", [], ["unloading_order_violation"])
assert above[0] == "unloading_order_violation"
assert free == ("optimal", [], [], {"later#1": "0", "first#1": "100"})
PYTHON
"$folder/venv/bin/python" "$folder/show.py"
