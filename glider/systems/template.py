"""The float class of a system that converts to other scalars, under a plain name."""

import inspect

from pydrake.systems.scalar_conversion import TemplateSystem


def float_class(template: TemplateSystem) -> type:
    """Returns a template's class for floats, with the name and arguments to read.

    Drake's own would be `GliderPlant_𝓣float𝓤(*args, **kwargs)`.
    """
    system = template[None]
    system.__name__ = system.__qualname__ = template.name.removesuffix("_")
    arguments = list(inspect.signature(system._construct).parameters.values())[1:]
    shown = [argument for argument in arguments if argument.name != "converter"]
    system.__signature__ = inspect.Signature(shown)
    return system
