"""Turns what pybind11 says of arguments that do not fit into one sentence: which argument, and what it takes."""

import ast
import difflib
import functools
import inspect
import numbers
import os

import numpy

# What pybind11 calls a type in a signature: what is accepted, and its words.
_TYPES = {
    "str": (str, "a text"),
    "int": (numbers.Integral, "a whole number"),
    "float": (numbers.Real, "a number"),
    "bool": (bool, "True or False"),
    "os.PathLike": ((str, bytes, os.PathLike), "the path of a file"),
    "numpy.ndarray": (numpy.ndarray, "a NumPy array"),
}


def _split(text):
    """The parts between the commas that are in no bracket and no quotes."""
    parts, depth, quoted = [""], 0, False
    for letter in text:
        quoted ^= letter == "'"
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def signature_of(doc):
    """The inspect.Signature in the first line of a docstring that pybind11 wrote."""
    line = (doc or "").splitlines()[0]
    head = line[line.index("(") + 1:line.rindex(") ->")]
    parameters = []
    for part in _split(head):
        name, _, rest = part.partition(":")
        kind, is_optional, default = rest.strip().partition(" = ")
        parameters.append(inspect.Parameter(
            name, inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=kind.strip(),
            default=ast.literal_eval(default) if is_optional else inspect.Parameter.empty))
    return inspect.Signature(parameters)


def _problem(name, value, kind):
    """Why `value` is not what `name` takes; None if it is."""
    if kind.startswith("Optional["):
        return None if value is None else _problem(name, value, kind[len("Optional["):-1])
    if kind.startswith("List["):
        return f"{name} is a list of (array, number, number)"
    if kind not in _TYPES:
        return None
    types, words = _TYPES[kind]
    if not isinstance(value, types) or (isinstance(value, bool) and kind != "bool"):
        is_file = kind == "numpy.ndarray" and isinstance(value, (str, bytes, os.PathLike))
        return f"{name} is {words}, not {type(value).__name__}" + (": read the file first, for example numpy.asarray(PIL.Image.open(file))" if is_file else "")
    if kind == "int" and not 0 <= value < 2**31:
        return f"{name} cannot be {value}"
    return None


def why_not(called, signature, args, kwargs):
    """The sentence of a call that does not fit."""
    unknown = [name for name in kwargs if name not in signature.parameters]
    if unknown:
        near = difflib.get_close_matches(unknown[0], signature.parameters, 1)
        return f"{called} has no argument {unknown[0]}" + (f": did you mean {near[0]}?" if near else f": see help({called})")
    try:
        given = signature.bind(*args, **kwargs).arguments
    except TypeError as error:
        return f"{called}: {error}: see help({called})"
    problems = [_problem(name, value, signature.parameters[name].annotation) for name, value in given.items()]
    return next((f"{called}: {problem}" for problem in problems if problem), f"{called} does not take these arguments: see help({called})")


def _plain(call, called):
    signature = signature_of(call.__doc__)

    @functools.wraps(call)
    def plain(*args, **kwargs):
        try:
            return call(*args, **kwargs)
        except TypeError as error:
            if "incompatible" not in str(error):
                raise
        raise TypeError(why_not(called, signature, args, kwargs))

    del plain.__wrapped__
    plain.__signature__ = signature
    plain.__module__ = "hord"
    return plain


def _not_made_by_hand(made):
    def __init__(self, *args, **kwargs):
        raise TypeError(f"a {made.__name__} is not made by hand: see help(hord.{made.__name__})")

    made.__init__ = __init__


def make_plain(names):
    """Replaces the functions among `names`, the names of a module, and the methods of its classes."""
    for name, thing in list(names.items()):
        if inspect.isclass(thing) and thing.__module__ == "hord._hord":
            for member, value in list(vars(thing).items()):
                held = getattr(value, "__func__", value)
                if (member.startswith("_") and member != "__init__") or not callable(held):
                    continue
                if ") ->" not in (held.__doc__ or ""):  # object's own __init__: the class has no constructor
                    _not_made_by_hand(thing)
                    continue
                called = f"hord.{name}" if member == "__init__" else f"hord.{name}.{member}"
                plain = _plain(held, called)
                setattr(thing, member, staticmethod(plain) if isinstance(value, staticmethod) else plain)
        elif inspect.isbuiltin(thing):
            names[name] = _plain(thing, f"hord.{name}")
