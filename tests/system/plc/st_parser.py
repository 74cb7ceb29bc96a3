"""Declarations and statements of Structured Text."""
import copy

from st import INTS, Array, RANGES, StError, Struct, Unit, Variable
from st_expressions import Expressions


class Parser(Expressions):
    """Adds what a text declares to a library."""

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
