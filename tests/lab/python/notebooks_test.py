"""The notebooks of lab/python/notebooks run to their end, and every figure and check in them."""
import os, tempfile, unittest

import nbclient, nbformat

from cell import BIN, SOURCE

FOLDER = os.path.join(SOURCE, "lab/python/notebooks")


class Notebooks(unittest.TestCase):
    def test_every_notebook_runs(self):
        names = sorted(name for name in os.listdir(FOLDER) if name.endswith(".ipynb"))
        self.assertGreaterEqual(len(names), 3)
        os.environ["PATH"] = BIN + os.pathsep + os.environ["PATH"]
        os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
        for name in names:
            with self.subTest(name), tempfile.TemporaryDirectory(prefix="hord-notebook.") as folder:
                notebook = nbformat.read(os.path.join(FOLDER, name), as_version=4)
                checks = sum("assert" in cell.source for cell in notebook.cells)
                nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3",
                                        resources={"metadata": {"path": folder}}).execute()
                pictures = sum("image/png" in out.get("data", {}) for cell in notebook.cells for out in cell.get("outputs", []))
                self.assertGreater(pictures, 0)
                self.assertGreater(checks, 1)
                self.assertFalse(any(cell.get("outputs") for cell in nbformat.read(os.path.join(FOLDER, name), 4).cells),
                                 "a notebook is kept without its outputs")


if __name__ == "__main__":
    unittest.main()
