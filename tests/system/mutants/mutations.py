"""The mutants of a C++ text, and the text that holds them all, each chosen when the program runs."""

import collections
import dataclasses
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[3]


@dataclasses.dataclass(frozen=True)
class Mutant:
    file: str  # below ROOT
    line: int
    begin: int  # characters that `text` replaces
    end: int
    text: str
    operator: str
    before: str  # the lines that change, white space collapsed
    after: str
    number: int = 0  # when it runs

    @property
    def key(self):
        return f"{self.file}\n  {self.before}\n  {self.after}"


COMMENT_OR_STRING = r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|(?<!\w)'(?:\\.|[^'\\\n])+'"


def masked(text):
    """The text with comments, strings, preprocessor lines and static_asserts blanked, of the same length."""
    blank = lambda m: re.sub(r"[^\n]", " ", m.group())
    text = re.sub(COMMENT_OR_STRING, blank, text, flags=re.S)
    text = re.sub(r"^[ \t]*#[^\n]*", blank, text, flags=re.M)
    return re.sub(r"\bstatic_assert\(.*?\);", blank, text, flags=re.S)


def closing(code, at):
    """Index of the bracket that closes the one at `at`."""
    depth = 0
    for k in range(at, len(code)):
        depth += code[k] in "([{"
        depth -= code[k] in ")]}"
        if depth == 0:
            return k
    return len(code) - 1


def members(code, begin, end):
    """The ranges between the commas of an argument list."""
    found, depth, start = [], 0, begin
    for k in range(begin, end):
        depth += code[k] in "([{"
        depth -= code[k] in ")]}"
        if code[k] == "," and depth == 0:
            found.append((start, k))
            start = k + 1
    return found + [(start, end)]


SWAPS = {
    "relational": {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="},
    "arithmetic": {"+": "-", "-": "+", "*": "/", "/": "*", "%": "*", "+=": "-=", "-=": "+="},
    "logical": {"&&": "||", "||": "&&", "&": "|", "|": "&", "<<": ">>", ">>": "<<", "|=": "&=", "&=": "|="},
}
DECLARATION = re.compile(r"(?:[^;=]*= default;|"
                         r"(?:const|static|constexpr|inline|explicit|virtual|friend|using|typedef|struct|class|enum|"
                         r"template|namespace|public|private|protected|goto|case|default|delete|throw)\b|"
                         r"\[\[|~|std::function<|"
                         r"[\w:]+<[^;=]*> \w+;|"
                         r"return\s*[^;\s]|(?!return\b|continue\b|break\b|else\b|co_)[\w:<>,*& ]+[\w>&*] [&*]?\w+\s*"
                         r"(?:=|;|\{|\(|,|:|$)|"
                         r"\w+\((?:const )?(?!new\b|const\b)[\w:<>]+[&*]? \w+[,)])")  # last: a constructor


def for_headers(code):
    return [(m.end() - 1, closing(code, m.end() - 1)) for m in re.finditer(r"\bfor \(", code)]


def statements(code, all_of_them=False):
    """The range of every simple statement, without its semicolon and without the if, else or for before it.

    Without all_of_them those after an if without else are left out: in another mutant this if is never true."""
    brackets, start = [], 0  # a bracket is True if it is the brace of a block
    for k, c in enumerate(code):
        block = True
        if c in "([":
            brackets.append(False)
        elif c == "{":
            opens = code[k - 1].isspace() and not re.search(r"(?:[=(,?:]|\breturn)\s*$", code[max(0, k - 90):k])
            brackets.append(opens and all(brackets))
        elif c in ")]}" and brackets:
            block = brackets.pop()
        elif c != ";":
            continue
        if not all(brackets) or c not in "{};" or not block:
            continue
        if c == ";":
            begin, alone = start, False
            while head := re.match(r"\s*(?:else\b|case [\w:]+:(?!:)|default:|(?:if|for|while) (?:constexpr )?\()",
                                   code[begin:k]):
                begin += head.end()
                alone = head.group().lstrip().startswith("if") and not code[k + 1:].lstrip().startswith("else")
                if head.group().endswith("("):
                    begin = closing(code, begin - 1) + 1
            begin += len(code[begin:k]) - len(code[begin:k].lstrip())
            if not alone or all_of_them:
                yield begin, begin + len(code[begin:k].rstrip())
        start = k + 1


def mutations(code):
    """(begin, end, text, operator) of every mutant of a masked text."""
    headers = for_headers(code)
    in_header = lambda at: any(b < at < e for b, e in headers)
    for kind, swaps in SWAPS.items():
        for m in re.finditer(r"(?<=\s)(<<|>>|<=|>=|==|!=|&&|\|\||\+=|-=|\|=|&=|[<>+\-*/%&|])(?=\s)", code):
            if m.group() in swaps:
                yield m.start(), m.end(), swaps[m.group()], kind
    for m in re.finditer(r"\+\+(?=[\w(])|--(?=[\w(])|(?<=\w)\+\+|(?<=\w)--", code):
        if not in_header(m.start()):
            yield m.start(), m.end(), "--" if m.group() == "++" else "++", "arithmetic"
    for m in re.finditer(r"(?<![\w.'])(?:0x[0-9A-Fa-f]+|\d+)(?=[uUlLzZ]*\b)(?![.'eE\d])", code):
        value = int(m.group(), 16 if m.group().startswith("0x") else 8 if m.group().startswith("0") else 10)
        for other in (value + 1, 0) if value == 1 else (value + 1,):
            yield m.start(), m.end(), str(other), "constant"
    for m in re.finditer(r"\b(true|false)\b", code):
        yield m.start(), m.end(), "false" if m.group() == "true" else "true", "constant"
    for m in re.finditer(r"\b(if|while) (?:constexpr )?\(", code):
        begin = m.end()
        end = closing(code, begin - 1)
        condition = code[begin:end]
        if re.match(r"[^()]*[^=!<>]=[^=]", condition) or ";" in condition:
            continue  # declares a variable
        same = re.fullmatch(r"!?[\w.:>()-]+(?<! -)(?: [!=]= [\w.:>()-]+)?", condition) and re.search(r"!|==", condition)
        if not same:  # as another mutant
            yield begin, begin, "!(", "negated condition:" + str(end)
        yield begin, begin, "false && (", "condition never true:" + str(end)
    for m in re.finditer(r"(?<=\s)\?(?=\s)", code):
        begin, depth = m.start(), 0
        while begin > 0:
            c = code[begin - 1]
            depth += c in ")]}"
            depth -= c in "([{"
            before = r"(?:\breturn|[^=!<>]=|\s:)\s$"
            if depth < 0 or (depth == 0 and (c in ";,?" or re.search(before, code[:begin][-8:]))):
                break
            begin -= 1
        while code[begin].isspace():
            begin += 1
        yield begin, begin, "!(", "negated condition:" + str(m.start())
    for m in re.finditer(r"(?<![\w)!])!(?=[\w(])", code):
        yield m.start(), m.end(), "", "negated condition"
    for m in re.finditer(r"\bstd::(max|min|clamp)(?:<[\w: ]+>)?\(", code):
        end = closing(code, m.end() - 1)
        parts = members(code, m.end(), end)
        if len(parts) < 2:
            continue
        for b, e in parts if m.group(1) != "clamp" else parts[:1]:
            yield m.start(), end + 1, f"<{b}:{e}>", "dropped member"
    for begin, end in statements(code):
        if end > begin and not DECLARATION.match(code[begin:end] + ";"):
            yield begin, end, "", "deleted statement"


def units(code):
    """Texts beside which a mutant can be compiled: (begin, end, form, rest); form and rest have a {} for each text."""
    condition, statement = "HORD_MUTANT({k}) ? bool({new}) : {rest}", "if (HORD_MUTANT({k})) {{ {new}; }} else {rest}"
    choice = "HORD_MUTANT({k}) ? ({new}) : {rest}"
    for m in re.finditer(r"\b(?:if|while) \(", code):
        end = closing(code, m.end() - 1)
        if ";" not in code[m.end():end] and not re.match(r"[^()]*[^=!<>]=[^=]", code[m.end():end]):
            yield m.end(), end, condition, "bool({})"
    for begin, end in for_headers(code):
        parts = code[begin + 1:end].split(";")
        if len(parts) == 3 and "=" in parts[0]:
            middle = begin + 1 + len(parts[0]) + 1
            yield begin + 1 + parts[0].rindex("=") + 1, middle - 1, choice, "({})"
            yield middle, middle + len(parts[1]), condition, "bool({})"
    for begin, end in statements(code, True):
        text = code[begin:end]
        if value := re.match(r"return\s+(?!\{)", text) or (DECLARATION.match(text + ";") and
                                                          re.match(r"[^()={}]*[^=!<>({]=\s(?!\{)", text)):
            yield begin + value.end(), end, choice, "({})"
        elif not DECLARATION.match(text + ";"):
            yield begin, end + 1, statement, "{{ {}; }}"


SCHEMA_HEAD = """extern int hord_mutant;
extern unsigned char* hord_reached;
#define HORD_MUTANT(k) (hord_reached[k] = 1, hord_mutant == (k))
#line 1
"""


def schema(file, mutants):
    """The file's text with these mutants beside the original; the lines of each; those that cannot be written so."""
    text = (ROOT / file).read_text()
    code = masked(text)
    # Without comments: one would end the line of a mutant.
    blank = lambda m: m.group() if m.group()[0] in "\"'" else re.sub(r"[^\n]", " ", m.group())
    plain = re.sub(COMMENT_OR_STRING, blank, text, flags=re.S)
    found = sorted(set(units(code)))
    of_unit, alone = collections.defaultdict(list), []
    for m in mutants:
        of = [u for u in found if u[0] <= m.begin and m.end <= u[1] and not (m.begin == m.end == u[1])]
        of_unit[min(of, key=lambda u: u[1] - u[0])].append(m) if of else alone.append(m)
    out, at, lines = SCHEMA_HEAD, 0, {}
    for (begin, end, form, rest), members_ in sorted(of_unit.items()):
        if begin < at:
            alone += members_
            continue
        out += plain[at:begin]
        semicolon = end if rest[0] != "{" else end - 1
        new = "\n"
        for m in members_:
            changed = (plain[begin:m.begin] + m.text + plain[m.end:semicolon]).replace("\n", " ")
            head, tail = form.split("{rest}")[0].format(k=m.number, new=changed), ""
            lines[(out + new).count("\n") - SCHEMA_HEAD.count("\n") + 1] = m
            new += head + "\n"
        new += rest.format(plain[begin:semicolon].replace("\n", " ")) + "\n"
        out += "{" + new + "}" if rest[0] == "{" else "(" + new + ")"
        at = end
    return out + plain[at:], lines, alone


def mutants_of(file):
    text = (ROOT / file).read_text()
    code = masked(text)
    seen = {}
    for begin, end, new, operator in mutations(code):
        if ":" in operator:  # closes a bracket, too
            operator, close = operator.split(":")
            end, new = int(close), new + text[begin:int(close)].rstrip() + ") "
        if member := re.fullmatch(r"<(\d+):(\d+)>", new):
            new = "(" + text[int(member[1]):int(member[2])].strip() + ")"
        first, last = text.rfind("\n", 0, begin) + 1, text.find("\n", end)
        flat = lambda s: re.sub(r"\s+", " ", s).strip()
        before, after = flat(text[first:last]), flat(text[first:begin] + new + text[end:last])
        if before == after or after in ("};",):
            continue
        count = seen[(before, after)] = seen.get((before, after), 0) + 1
        if count > 1:
            after += f"  // {count}"
        yield Mutant(file, text.count("\n", 0, begin) + 1, begin, end, new, operator, before, after)
