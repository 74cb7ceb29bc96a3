"""The package itself: stubs and docstrings are those of the module, and README's lines run."""
import ast, inspect, os, re, shutil, subprocess, sys, tempfile, unittest

import hord
from cell import BIN, SOURCE, Cell


def stub():
    with open(os.path.join(os.path.dirname(hord.__file__), "__init__.pyi")) as file:
        return ast.parse(file.read())


def members(node):
    return {part.name: part for part in node.body if isinstance(part, ast.FunctionDef)}


def arguments_of(docstring):
    """The names of the arguments in the first line of what pybind11 writes: decode(frame: numpy.ndarray, bins: ...)."""
    first = docstring.splitlines()[0]
    inside = re.sub(r"\[[^\[\]]*\]|\[[^\[\]]*\[[^\[\]]*\][^\[\]]*\]", "", first[first.index("(") + 1:first.rindex(")")])
    return [part.split(":")[0].strip() for part in inside.split(", ") if ":" in part and part.split(":")[0].strip().isidentifier()]


class Stub(unittest.TestCase):
    def test_it_names_what_the_module_has(self):
        named = {node.name for node in stub().body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
        held = {name for name in hord.__all__ if inspect.isclass(getattr(hord, name)) or callable(getattr(hord, name))}
        errors = {name for name in held if inspect.isclass(getattr(hord, name)) and issubclass(getattr(hord, name), Exception)}
        self.assertEqual(named, held - errors)
        for name in hord.__all__:
            self.assertTrue(hasattr(hord, name), name)

    def test_classes_have_the_members_that_it_names(self):
        for node in (part for part in stub().body if isinstance(part, ast.ClassDef)):
            named = set(members(node)) - {"__init__"}
            held = {name for name in vars(getattr(hord, node.name)) if not name.startswith("_")}
            self.assertEqual(named, held, node.name)

    def test_functions_have_the_arguments_that_it_names(self):
        checked = 0
        for node in stub().body:
            pairs = []
            if isinstance(node, ast.FunctionDef):
                pairs.append((node, getattr(hord, node.name)))
            elif isinstance(node, ast.ClassDef):
                pairs += [(part, getattr(getattr(hord, node.name), name)) for name, part in members(node).items()
                          if not any(isinstance(d, ast.Name) and d.id == "property" for d in part.decorator_list)]
            for part, held in pairs:
                named = [argument.arg for argument in part.args.args if argument.arg != "self"]
                found = [name for name in arguments_of(held.__doc__) if name != "self"]
                self.assertEqual(named, found, f"{part.name}: {held.__doc__.splitlines()[0]}")
                checked += 1
        self.assertGreater(checked, 20)

    def test_everything_says_what_it_is(self):
        for name in hord.__all__:
            thing = getattr(hord, name)
            if not inspect.isclass(thing) and not callable(thing):
                continue
            self.assertTrue(thing.__doc__ and len(thing.__doc__) > 15, name)
            if inspect.isclass(thing) and not issubclass(thing, Exception):
                for member, value in vars(thing).items():
                    if not member.startswith("_"):
                        value = getattr(value, "__func__", value)
                        self.assertTrue(value.__doc__ and len(value.__doc__) > 10, f"{name}.{member}")

    def test_it_is_typed(self):
        self.assertTrue(os.path.exists(os.path.join(os.path.dirname(hord.__file__), "py.typed")))


class Package(unittest.TestCase):
    def test_another_python_is_told_what_the_module_was_built_for(self):
        with tempfile.TemporaryDirectory(prefix="hord-package.") as folder:
            shutil.copytree(os.path.dirname(hord.__file__), os.path.join(folder, "hord"), ignore=shutil.ignore_patterns("_hord*"))
            open(os.path.join(folder, "hord/_hord.cpython-27-other.so"), "w").close()
            done = subprocess.run([sys.executable, "-c", "import hord"], env={**os.environ, "PYTHONPATH": folder}, capture_output=True, text=True)
        self.assertRegex(done.stderr, r"ImportError: hord cannot be used by this Python \(.*\): it holds _hord.cpython-27-other.so: call the Python")


class Pages(unittest.TestCase):
    def test_the_lines_of_the_readme_run(self):
        with open(os.path.join(SOURCE, "README.md"), encoding="utf-8") as file:
            block = re.search(r"^    export PYTHONPATH=.*\n((?:    .*\n)+)", file.read(), re.M)[1]
        lines = [line.strip() for line in block.splitlines()]
        self.assertEqual([line.split()[0] for line in lines], ["build/release/bin/hord-lab", "python3", "python3"])
        with tempfile.TemporaryDirectory(prefix="hord-readme.") as folder:
            for line in lines:
                line = line.replace("python3", sys.executable, 1).replace("build/release/bin", BIN)
                line = line.replace(" hal_sim/", f" {SOURCE}/hal_sim/")
                done = subprocess.run(line, shell=True, cwd=folder, capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, line + done.stderr)
                self.assertTrue("pass" in done.stdout or "render" in line, done.stdout)

    def test_the_blocks_of_the_page_run(self):
        with open(os.path.join(SOURCE, "docs/python.md"), encoding="utf-8") as file:
            blocks = re.findall(r"```python\n(.*?)```", file.read(), re.S)
        self.assertGreater(len(blocks), 3)
        cell = Cell()
        before = os.getcwd()
        try:
            cell.render("part")
            cell.good_parts(8)
            os.mkdir(cell.path("good"))
            for k in range(8):
                os.rename(cell.path(f"good{k}.png"), cell.path(f"good/{k}.png"))
            os.chdir(cell.folder.name)
            space = {}
            for block in blocks:
                exec(compile(block, "docs/python.md", "exec"), space)
        finally:
            os.chdir(before)
            cell.close()


if __name__ == "__main__":
    unittest.main()
