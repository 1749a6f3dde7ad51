"""Environments made: from a scenario's few lines to a folder with room, wind, scene and picture, cached."""

from gslcosim.generation.batch import MadeEnvironment, Order, generate_many, orders_of
from gslcosim.generation.making import generate_environment, save_with_views
from gslcosim.generation.preparing import prepare_environment
from gslcosim.generation.recipe_hash import recipe_hash
from gslcosim.generation.winds import Progress

__all__ = [
    "MadeEnvironment",
    "Order",
    "Progress",
    "generate_environment",
    "generate_many",
    "orders_of",
    "prepare_environment",
    "recipe_hash",
    "save_with_views",
]
