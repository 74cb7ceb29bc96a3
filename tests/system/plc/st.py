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


def name_of(kind):
    if isinstance(kind, Array):
        return f"ARRAY[{kind.low}..{kind.high}] OF {name_of(kind.of)}"
    return kind if isinstance(kind, str) else kind.name


class Parser:
    """Compiles to Python functions of a memory (a dict of variables). An expression is (type, function); the type of a
    plain number is "number" until something gives it one."""

    def __init__(self, library, text, name):
        self.library, self.text = library, text
        self.tokens, self.at = tokens_of(text, name), 0
        self.unit = None
        self.loops = []

    # -- tokens

    def fail(self, why):
        where = self.tokens[min(self.at, len(self.tokens) - 1)][2] if self.tokens else "empty"
        raise StError(f"{where}: {why}")

    def peek(self):
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def take(self, *wanted):
        token = self.peek()
        if wanted and token not in wanted:
            self.fail(f"{' or '.join(wanted)} expected, not {token!r}")
        self.at += 1
        return token

    def found(self, token):
        if self.peek() == token:
            self.at += 1
            return True
        return False

    def new_name(self):
        kind, text = self.tokens[self.at][:2]
        if kind != "name" or text.upper() in KEYWORDS:
            self.fail(f"{text} is no name: a keyword, or no word")
        self.at += 1
        return text

    def comment_behind(self):
        """The comment on the rest of this line and on lines below it that hold nothing else."""
        rest = self.text[self.tokens[self.at - 1][4]:]
        match = re.match(r"[ \t]*\(\*(.*?)\*\)", rest, re.S)
        return " ".join(match.group(1).split()) if match else ""

    def comment_before(self):
        match = re.search(r"\(\*((?:(?!\*\)).)*)\*\)\s*$", self.text[:self.tokens[self.at][3]], re.S)
        return match.group(1).strip() if match else ""

    # -- declarations

    def everything(self):
        while self.at < len(self.tokens):
            what = self.peek()
            if what == "TYPE":
                self.declare_types()
            elif what == "VAR_GLOBAL":
                self.declare_globals()
            elif what in ("FUNCTION", "FUNCTION_BLOCK", "PROGRAM"):
                self.declare_unit(what)
            else:
                self.fail(f"a declaration expected, not {what!r}")

    def declare_types(self):
        self.take("TYPE")
        while not self.found("END_TYPE"):
            name = self.new_name()
            self.take(":")
            if self.found("STRUCT"):
                members, comments = {}, {}
                while not self.found("END_STRUCT"):
                    member = self.new_name()
                    self.take(":")
                    members[member] = self.type()
                    self.take(";")
                    comments[member] = self.comment_behind()
                self.library.types[name] = Struct(name, members)
                self.library.types[name].comments = comments
            else:
                array = self.type()
                array.name = name
                self.library.types[name] = array
            self.take(";")

    def type(self):
        name = self.take()
        if name == "ARRAY":
            self.take("[")
            low = int(self.take())
            self.take("..")
            high = int(self.take())
            self.take("]")
            self.take("OF")
            return Array(low, high, self.type())
        if name in RANGES or name in ("BOOL", "TIME"):
            return name
        for known in (self.library.types, self.library.units):
            if name in known:
                return known[name]
        self.at -= 1
        self.fail(f"type {name} is not known")

    def declare_variables(self, into):
        section = self.take()
        retain, constant = self.found("RETAIN"), self.found("CONSTANT")
        while not self.found("END_VAR"):
            name = self.new_name()
            if name in into or (self.unit and name == self.unit.name):
                self.fail(f"{name} is declared twice")
            self.take(":")
            kind, initial = self.type(), None
            if self.found(":="):
                initial = self.typed(self.expression(), kind)({})
                self.check_range(kind, initial)
            self.take(";")
            into[name] = Variable(name, kind, initial, section, retain, constant, self.comment_behind())

    def declare_globals(self):
        self.declare_variables(self.library.globals)

    def declare_unit(self, what):
        comment = self.comment_before()
        self.take(what)
        name = self.new_name()
        returns = None
        if what == "FUNCTION":
            self.take(":")
            returns = self.type()
        unit = self.unit = Unit(what, name, returns)
        unit.comment = comment
        while self.peek().startswith("VAR"):
            self.declare_variables(unit.variables)
        begin = self.tokens[self.at - 1][4]
        unit.body = self.statements("END_" + what)
        unit.text = self.text[begin:self.tokens[self.at][3]]
        self.take("END_" + what)
        self.library.units[name] = unit
        self.unit = None

    # -- statements

    def statements(self, *until):
        out = []
        while self.peek() not in until:
            if self.at >= len(self.tokens):
                self.fail(f"{until[0]} is missing")
            out.append(self.statement())
        return out

    def block(self, *until):
        body = self.statements(*until)

        def run(memory):
            for statement in body:
                statement(memory)
        return run

    def statement(self):
        where = self.tokens[self.at][2]
        word = self.peek()
        make = {"IF": self.if_statement, "CASE": self.case_statement, "FOR": self.for_statement, "WHILE": self.while_statement}.get(word)
        run = make() if make else self.assignment_or_call()
        self.take(";")

        def told(memory):
            try:
                run(memory)
            except StError as error:
                raise StError(str(error) if ":" in str(error).split(" ")[0] else f"{where}: {error}") from None
        return told

    def condition(self):
        return self.typed(self.expression(), "BOOL")

    def if_statement(self):
        self.take("IF")
        branches = []
        while True:
            condition = self.condition()
            self.take("THEN")
            branches.append((condition, self.block("ELSIF", "ELSE", "END_IF")))
            if not self.found("ELSIF"):
                break
        otherwise = self.block("END_IF") if self.found("ELSE") else None
        self.take("END_IF")

        def run(memory):
            for condition, body in branches:
                if condition(memory):
                    return body(memory)
            if otherwise:
                otherwise(memory)
        return run

    def case_statement(self):
        self.take("CASE")
        kind, selector = self.expression()
        if kind not in INTS:
            self.fail("CASE needs an integer")
        self.take("OF")
        branches, otherwise = {}, None
        while self.peek() not in ("ELSE", "END_CASE"):
            labels = [self.label(kind)]
            while self.found(","):
                labels.append(self.label(kind))
            self.take(":")
            body = []
            while self.peek() not in ("ELSE", "END_CASE") and not self.at_label():
                body.append(self.statement())
            for label in labels:
                if label in branches:
                    self.fail(f"CASE has {label} twice")
                branches[label] = body
        if self.found("ELSE"):
            otherwise = self.statements("END_CASE")
        self.take("END_CASE")

        def run(memory):
            for statement in branches.get(selector(memory), otherwise or []):
                statement(memory)
        return run

    def at_label(self):
        ahead = self.tokens[self.at:self.at + 2]
        return len(ahead) == 2 and ahead[1][1] in (":", ",")

    def label(self, kind):
        return self.typed(self.expression(constant=True), kind)(
            {v.name: v.initial for v in self.unit.variables.values() if v.constant})

    def for_statement(self):
        self.take("FOR")
        name = self.new_name()
        variable = self.unit.variables.get(name)
        if not variable or variable.type not in INTS or name in self.loops:
            self.fail(f"FOR needs an integer variable of its own, not {name}")
        self.take(":=")
        first = self.typed(self.expression(), variable.type)
        self.take("TO")
        last = self.typed(self.expression(), variable.type)
        self.take("DO")
        self.loops.append(name)
        body = self.block("END_FOR")
        self.loops.pop()
        self.take("END_FOR")

        def run(memory):
            for value in range(first(memory), last(memory) + 1):
                memory[name] = value
                body(memory)
            memory[name] = None  # its value after the loop is not defined: whoever uses it fails
        return run

    def while_statement(self):
        self.take("WHILE")
        condition = self.condition()
        self.take("DO")
        body = self.block("END_WHILE")
        self.take("END_WHILE")

        def run(memory):
            turns = 0
            while condition(memory):
                body(memory)
                turns += 1
                if turns > 10000:
                    raise StError("a WHILE that does not end would stop the PLC")
        return run

    def assignment_or_call(self):
        name = self.peek()
        variable = self.unit.variables.get(name)
        if variable and isinstance(variable.type, Unit) and self.tokens[self.at + 1][1] == "(":
            return self.call_block(name, variable.type)
        kind, place = self.place(to_write=True)
        self.take(":=")
        value = self.typed(self.expression(), kind)
        is_part = isinstance(kind, (Array, Struct))

        def run(memory):
            container, key = place(memory)
            new = copy.deepcopy(value(memory)) if is_part else value(memory)
            self.check_range(kind, new)
            container[key] = new
        return run

    def call_block(self, name, unit):
        self.take(name)
        inputs, references = [], []
        for variable, passed in self.arguments(unit):
            (references if variable.section == "VAR_IN_OUT" else inputs).append((variable, passed))
        missing = {v.name for v in unit.variables.values() if v.section == "VAR_IN_OUT"} - {v.name for v, _ in references}
        if missing:
            self.fail(f"{unit.name} needs {', '.join(missing)}")

        def run(memory):
            instance = memory[name]
            for variable, value in inputs:
                new = copy.deepcopy(value(memory))
                self.check_range(variable.type, new)
                instance.memory[variable.name] = new
            for variable, place in references:
                container, key = place(memory)
                instance.memory[variable.name] = container[key]
            self.library.run(instance)
            for variable, _ in references:
                del instance.memory[variable.name]
        return run

    def arguments(self, unit):
        """(variable, function) of each: a value, or a place for VAR_IN_OUT. Always by name."""
        self.take("(")
        out = []
        while not self.found(")"):
            if out:
                self.take(",")
            name = self.new_name()
            variable = unit.variables.get(name)
            if not variable or variable.section not in ("VAR_INPUT", "VAR_IN_OUT") or name in [v.name for v, _ in out]:
                self.fail(f"{unit.name} has no input {name}, or it is given twice")
            self.take(":=")
            if variable.section == "VAR_IN_OUT":
                kind, place = self.place(to_write=True)
                if kind is not variable.type or not isinstance(kind, (Array, Struct)):
                    self.fail(f"{name} must be a {name_of(variable.type)}, not {name_of(kind)}")
                out.append((variable, place))
            else:
                out.append((variable, self.typed(self.expression(), variable.type)))
        return out

    # -- expressions: OR, XOR, AND, comparison, sum, product, unary

    def expression(self, constant=False):
        left = self.and_expression() if not constant else self.unary()
        while not constant and self.peek() in ("OR", "XOR"):
            left = self.bitwise(self.take(), left, self.and_expression())
        return left

    def and_expression(self):
        left = self.comparison()
        while self.peek() == "AND":
            left = self.bitwise(self.take(), left, self.comparison())
        return left

    def bitwise(self, operator, left, right):
        kind, a, b = self.same(left, right)
        if kind not in BITS:
            self.fail(f"{operator} of {name_of(kind)}")
        return kind, {"AND": lambda m: a(m) & b(m), "OR": lambda m: a(m) | b(m), "XOR": lambda m: a(m) ^ b(m)}[operator]

    def comparison(self):
        left = self.sum()
        if self.peek() in ("=", "<>", "<", ">", "<=", ">="):
            operator = self.take()
            kind, a, b = self.same(left, self.sum())
            if not isinstance(kind, str) or (kind in BITS and operator not in ("=", "<>")):
                self.fail(f"{operator} of {name_of(kind)}")
            left = "BOOL", {"=": lambda m: a(m) == b(m), "<>": lambda m: a(m) != b(m), "<": lambda m: a(m) < b(m),
                            ">": lambda m: a(m) > b(m), "<=": lambda m: a(m) <= b(m), ">=": lambda m: a(m) >= b(m)}[operator]
        return left

    def sum(self):
        left = self.product()
        while self.peek() in ("+", "-"):
            left = self.arithmetic(self.take(), left, self.product())
        return left

    def product(self):
        left = self.unary()
        while self.peek() in ("*", "/", "MOD"):
            left = self.arithmetic(self.take(), left, self.unary())
        return left

    def arithmetic(self, operator, left, right):
        kind, a, b = self.same(left, right)
        if kind not in INTS and kind != "number":
            self.fail(f"{operator} of {name_of(kind)}")

        def run(memory):
            x, y = a(memory), b(memory)
            if operator in ("/", "MOD") and y == 0:
                raise StError("division by zero")
            value = {"+": lambda: x + y, "-": lambda: x - y, "*": lambda: x * y, "/": lambda: abs(x) // abs(y) * (1 if x * y >= 0 else -1),
                     "MOD": lambda: abs(x) % abs(y) * (1 if x >= 0 else -1)}[operator]()
            self.check_range(kind, value)
            return value
        return kind, run

    def unary(self):
        if self.found("NOT"):
            kind, value = self.unary()
            if kind == "BOOL":
                return kind, lambda m: not value(m)
            if kind not in BITS:
                self.fail(f"NOT of {name_of(kind)}")
            mask = RANGES[kind][1]
            return kind, lambda m: value(m) ^ mask
        if self.found("-"):
            kind, value = self.unary()
            return kind, lambda m: -value(m)
        if self.found("("):
            inside = self.expression()
            self.take(")")
            return inside
        kind, text = self.tokens[self.at][:2]
        if kind in ("number", "based", "time"):
            self.at += 1
            number = milliseconds(text) if kind == "time" else int(text.split("#")[-1], int(text.split("#")[0]) if kind == "based" else 10)
            return {"number": "number", "based": "bits", "time": "TIME"}[kind], lambda m: number
        if text in ("TRUE", "FALSE"):
            self.at += 1
            return "BOOL", lambda m: text == "TRUE"
        if self.at + 1 < len(self.tokens) and self.tokens[self.at + 1][1] == "(":
            return self.call_function()
        kind, place = self.place()

        def read(memory):
            container, key = place(memory)
            if container[key] is None:
                raise StError(f"{text} is used after its FOR, where its value is not defined")
            return container[key]
        return kind, read

    def call_function(self):
        name = self.take()
        conversion = re.fullmatch(r"([A-Z]+)_TO_([A-Z]+)", name)
        if conversion and conversion[1] in RANGES and conversion[2] in RANGES:
            self.take("(")
            value = self.typed(self.expression(), conversion[1])
            self.take(")")

            def convert(memory):
                number = value(memory)
                self.check_range(conversion[2], number)
                return number
            return conversion[2], convert
        function = self.library.units.get(name)
        if not function or function.what != "FUNCTION":
            self.fail(f"function {name} is not known")
        given = self.arguments(function)
        if len(given) != len(function.inputs()):
            self.fail(f"{name} needs {len(function.inputs())} inputs")

        def run(memory):
            mine = self.library.instance(name).memory
            mine.update({variable.name: value(memory) for variable, value in given})
            mine[name] = None
            for statement in function.body:
                statement(mine)
            if mine[name] is None:
                raise StError(f"{name} gave no value")
            return mine[name]
        return function.returns, run

    def place(self, to_write=False):
        """Where a variable or a part of it is: a function that gives (container, key)."""
        name = self.new_name()
        unit = self.unit
        if to_write and unit.returns is not None and name == unit.name:
            return unit.returns, lambda m: (m, name)
        variable = unit.variables.get(name) or self.library.globals.get(name)
        if not variable:
            self.at -= 1
            self.fail(f"{name} is not declared")
        inside = self.peek() in (".", "[")
        if to_write and (variable.constant or variable.section == "VAR_INPUT" or name in self.loops):
            self.fail(f"{name} cannot be written: an input, a constant, or the variable of a FOR")
        kind = variable.type
        if name in self.library.globals and name not in unit.variables:
            shared = {name: variable.initial}
            place = lambda m: (shared, name)
        else:
            place = lambda m: (m, name)
        while inside:
            if self.found("["):
                if not isinstance(kind, Array):
                    self.fail(f"{name_of(kind)} is no array")
                index_kind, index = self.expression()
                if index_kind not in INTS and index_kind != "number":
                    self.fail("an index is an integer")
                self.take("]")
                kind, place = kind.of, self.element(kind, place, index)
            else:
                self.take(".")
                member = self.new_name()
                kind, place = self.member(kind, place, member, to_write)
            inside = self.peek() in (".", "[")
        return kind, place

    @staticmethod
    def element(array, place, index):
        def run(memory):
            container, key = place(memory)
            at = index(memory)
            if not array.low <= at <= array.high:
                raise StError(f"index {at} is not in {array.low}..{array.high}")
            return container[key], at - array.low
        return run

    def member(self, kind, place, member, to_write):
        if isinstance(kind, Struct) and member in kind.members:
            def inside(memory):
                container, key = place(memory)
                return container[key], member
            return kind.members[member], inside
        if isinstance(kind, Unit):
            variable = kind.variables.get(member)
            if not variable or variable.section not in ("VAR_INPUT", "VAR_OUTPUT") or to_write:
                self.fail(f"{kind.name}.{member} is not readable from outside, or is written there")

            def of_instance(memory):
                container, key = place(memory)
                return container[key].memory, member
            return variable.type, of_instance
        self.fail(f"{name_of(kind)} has no {member}")

    # -- types

    def same(self, left, right):
        """Both sides with one type: a plain number takes the other's."""
        (a, x), (b, y) = left, right
        for one, other in ((a, b), (b, a)):
            if (one == "number" and other in INTS) or (one == "bits" and (other in BITS or other in INTS)):
                return other, x, y
        if a is not b and a != b:
            self.fail(f"{name_of(a)} and {name_of(b)} are different types: convert one")
        return a, x, y

    def typed(self, expression, wanted):
        kind, value = expression
        fits = kind is wanted or kind == wanted or (kind == "number" and wanted in INTS) or (
            kind == "bits" and (wanted in BITS and wanted != "BOOL" or wanted in INTS))
        if not fits:
            self.fail(f"{name_of(kind)} where {name_of(wanted)} is needed: convert it")
        return value

    @staticmethod
    def check_range(kind, value):
        if kind in RANGES and not RANGES[kind][0] <= value <= RANGES[kind][1]:
            raise StError(f"{value} does not fit into {kind}")
