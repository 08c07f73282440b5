"""Objects: the catalogue, shape builders, users' own meshes, rest poses."""

from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS, ObjectSpec
from dexgrasp_env.objects.load import load_object, object_name, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import ContactPart

__all__ = [
    "CATALOGUE",
    "OBJECT_SETS",
    "ContactPart",
    "ObjectModel",
    "ObjectSpec",
    "load_object",
    "object_name",
    "resolve_targets",
]
