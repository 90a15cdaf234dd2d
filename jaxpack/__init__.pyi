"""The public names, one a line: type checkers read this, and so does `__init__.py`."""

from jaxpack.batches import orders_as_rows as orders_as_rows
from jaxpack.batches import solve_batch as solve_batch
from jaxpack.comparison import Comparison as Comparison
from jaxpack.comparison import compare as compare
from jaxpack.errors import UserError as UserError
from jaxpack.io.jobs import read_job as read_job
from jaxpack.io.weights import load_policy as load_policy
from jaxpack.io.weights import save_policy as save_policy
from jaxpack.learning.presets import preset as preset
from jaxpack.learning.recipe import Policy as Policy
from jaxpack.learning.recipe import TrainConfig as TrainConfig
from jaxpack.learning.trainer import make_train as make_train
from jaxpack.many import solve_many as solve_many
from jaxpack.methods import MethodOptions as MethodOptions
from jaxpack.methods import make_method as make_method
from jaxpack.model.instances import Cell as Cell
from jaxpack.model.instances import Distribution as Distribution
from jaxpack.model.instances import sample as sample
from jaxpack.model.job import BinType as BinType
from jaxpack.model.job import ItemType as ItemType
from jaxpack.model.job import Job as Job
from jaxpack.model.job import PackedBin as PackedBin
from jaxpack.model.job import Placement as Placement
from jaxpack.model.job import Plan as Plan
from jaxpack.model.packing_check import check_packings as check_packings
from jaxpack.model.plan_check import InvalidPlanError as InvalidPlanError
from jaxpack.model.plan_check import check_plan as check_plan
from jaxpack.model.problem import Instance as Instance
from jaxpack.model.problem import Packing as Packing
from jaxpack.model.problem import Problem as Problem
from jaxpack.model.problem import make_instance as make_instance
from jaxpack.model.rules import Rules as Rules
from jaxpack.packing.env import Choice as Choice
from jaxpack.packing.env import observe as observe
from jaxpack.packing.env import positions as positions
from jaxpack.packing.env import reset as reset
from jaxpack.packing.env import step as step
from jaxpack.packing.first_fit import pack as pack
from jaxpack.packing.table import Table as Table
from jaxpack.solution import Solution as Solution
from jaxpack.solution import solve as solve
from jaxpack.xla.devices import use_all_cores as use_all_cores
from jaxpack.xla.programs import tune_for_cpu as tune_for_cpu

__version__: str
