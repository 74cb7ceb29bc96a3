"""Structured Text (IEC 61131-3, edition 3): a parser and an interpreter for the subset that deploy/plc uses.

It is stricter than PLCs are, so that what it runs compiles everywhere: types are never converted silently, an index or
a value out of its range is an error and does not wrap, both sides of AND and OR are evaluated, and keywords of any part
of the standard are no names.
"""
import copy
import re
import time

RANGES = {"BYTE": (0, 0xFF), "WORD": (0, 0xFFFF), "DWORD": (0, 0xFFFFFFFF), "INT": (-0x8000, 0x7FFF), "UINT": (0, 0xFFFF),
          "DINT": (-0x80000000, 0x7FFFFFFF), "UDINT": (0, 0xFFFFFFFF)}
BITS = {"BOOL", "BYTE", "WORD", "DWORD"}
INTS = {"INT", "UINT", "DINT", "UDINT"}
KEYWORDS = set("""ABSTRACT ACTION AND ARRAY AT BOOL BY BYTE CASE CHAR CLASS CONFIGURATION CONSTANT CONTINUE DATE DINT DO DWORD ELSE ELSIF
END_ACTION END_CASE END_CLASS END_CONFIGURATION END_FOR END_FUNCTION END_FUNCTION_BLOCK END_IF END_INTERFACE END_METHOD END_NAMESPACE
END_PROGRAM END_REPEAT END_RESOURCE END_STEP END_STRUCT END_TRANSITION END_TYPE END_VAR END_WHILE EXIT EXTENDS FALSE FINAL FOR FROM
FUNCTION FUNCTION_BLOCK F_EDGE IF IMPLEMENTS INITIAL_STEP INT INTERFACE INTERNAL INTERVAL LINT LREAL LWORD METHOD MOD NAMESPACE
NON_RETAIN NOT NULL OF ON OR OVERLAP OVERRIDE PRIORITY PRIVATE PROGRAM PROTECTED PUBLIC READ_ONLY READ_WRITE REAL REF REF_TO REPEAT
RESOURCE RETAIN RETURN R_EDGE SINGLE SINT STEP STRING STRUCT SUPER TASK THEN THIS TIME TO TRANSITION TRUE TYPE UDINT UINT ULINT UNTIL
USING USINT VAR VAR_ACCESS VAR_CONFIG VAR_EXTERNAL VAR_GLOBAL VAR_INPUT VAR_IN_OUT VAR_OUTPUT VAR_TEMP WHILE WITH WORD WSTRING XOR
""".split())
TOKEN = re.compile(r"""(?P<space>\s+|\(\*.*?\*\))|(?P<time>T\#[0-9a-z]+)|(?P<based>(?:16|2)\#[0-9A-Fa-f]+)|(?P<number>\d+)
                   |(?P<name>[A-Za-z_]\w*)|(?P<op>:=|=>|<>|<=|>=|\.\.|[-+*/()\[\],;:.<>=])""", re.S | re.X)


class StError(Exception):
    """What a compiler would refuse, or what would go wrong in the PLC."""


class Array:
    def __init__(self, low, high, of):
        self.low, self.high, self.of = low, high, of


class Struct:
    def __init__(self, name, members):
        self.name, self.members = name, members


class Variable:
    def __init__(self, name, kind, initial, section, retain, constant, comment):
        self.name, self.type, self.initial, self.section = name, kind, initial, section
        self.retain, self.constant, self.comment = retain, constant, comment


class Unit:
    """A FUNCTION, FUNCTION_BLOCK or PROGRAM."""

    def __init__(self, what, name, returns):
        self.what, self.name, self.returns = what, name, returns
        self.variables, self.body, self.text, self.comment = {}, [], "", ""
        self.native = None  # Python instead of the body: called with the instance's memory

    def inputs(self):
        return [v for v in self.variables.values() if v.section == "VAR_INPUT"]


class Instance:
    def __init__(self, unit, memory):
        self.unit, self.memory = unit, memory


def tokens_of(text, name):
    at, line, out = 0, 1, []
    while at < len(text):
        match = TOKEN.match(text, at)
        if not match:
            raise StError(f"{name}:{line}: what is {text[at:at + 10]!r}?")
        if match.lastgroup != "space":
            out.append((match.lastgroup, match.group(), f"{name}:{line}", match.start(), match.end()))
        line += match.group().count("\n")
        at = match.end()
    return out


def milliseconds(text):
    parts = re.findall(r"(\d+)(ms|s|m|h)", text[2:])
    if "".join(n + unit for n, unit in parts) != text[2:]:
        raise StError(f"{text} is no time")
    return sum(int(n) * {"ms": 1, "s": 1000, "m": 60000, "h": 3600000}[unit] for n, unit in parts)


class Library:
    """Types, functions, function blocks and programs of some texts; TON is there."""

    def __init__(self, clock=time.monotonic):
        self.types, self.units, self.globals = {}, {}, {}
        self.clock = clock
        self.watchers = {}  # unit's name: function of the memory, called after each of its cycles
        self.add("FUNCTION_BLOCK TON VAR_INPUT IN : BOOL; PT : TIME; END_VAR VAR_OUTPUT Q : BOOL; ET : TIME; END_VAR "
                 "VAR Begun : TIME; Runs : BOOL; END_VAR END_FUNCTION_BLOCK", "TON")
        self.units["TON"].native = self._ton

    def _ton(self, memory):
        now = int(self.clock() * 1000)
        if memory["IN"] and not memory["Runs"]:
            memory["Begun"] = now
        memory["Runs"] = memory["IN"]
        memory["ET"] = min(now - memory["Begun"], memory["PT"]) if memory["IN"] else 0
        memory["Q"] = memory["IN"] and memory["ET"] >= memory["PT"]

    def add(self, text, name):
        from st_parser import Parser  # it needs this module
        Parser(self, text, name).everything()

    def native(self, unit, function):
        self.units[unit].native = function

    def instance(self, name, kept=None):
        """Of a program or function block. `kept`: the memory of an instance whose RETAIN variables go on."""
        unit = self.units[name]
        made = Instance(unit, {v.name: self.initial(v) for v in unit.variables.values() if v.section != "VAR_IN_OUT"})
        for variable in unit.variables.values():
            if kept and variable.retain:
                made.memory[variable.name] = copy.deepcopy(kept.memory[variable.name])
        return made

    def initial(self, variable):
        return copy.deepcopy(variable.initial) if variable.initial is not None else self.zero(variable.type)

    def zero(self, kind):
        if isinstance(kind, Array):
            return [self.zero(kind.of) for _ in range(kind.low, kind.high + 1)]
        if isinstance(kind, Struct):
            return {name: self.zero(of) for name, of in kind.members.items()}
        if isinstance(kind, Unit):
            return self.instance(kind.name)
        return False if kind == "BOOL" else 0

    def run(self, instance):
        """One cycle."""
        if instance.unit.native:
            instance.unit.native(instance.memory)
        else:
            for statement in instance.unit.body:
                statement(instance.memory)
        if instance.unit.name in self.watchers:
            self.watchers[instance.unit.name](instance.memory)
