"""Expressions of Structured Text, compiled to Python functions of a memory (a dict of variables)."""
import re

from st import Array, BITS, INTS, KEYWORDS, RANGES, StError, Struct, Unit, milliseconds, tokens_of


def name_of(kind):
    if isinstance(kind, Array):
        return f"ARRAY[{kind.low}..{kind.high}] OF {name_of(kind.of)}"
    return kind if isinstance(kind, str) else kind.name


class Expressions:
    """An expression is (type, function); the type of a plain number is "number", and "bits" if it has a base, until
    something gives it one."""

    def __init__(self, library, text, name):
        self.library, self.text = library, text
        self.tokens, self.at = tokens_of(text, name), 0
        self.unit = None  # the one that is compiled
        self.loops = []   # variables of the FORs around

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
