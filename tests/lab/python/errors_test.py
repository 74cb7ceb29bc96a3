"""What `import hord` refuses: the words of hordctl, in the terms of Python."""
import functools, inspect, os, pathlib, subprocess, sys, unittest

import numpy as np

import hord
from cell import BUBBLE, Cell, hordctl, pixels, white_frame


def setUpModule():
    global cell, lens, bubble
    cell = Cell()
    lens, bubble = cell.render("lens"), cell.render("bubble", BUBBLE)


def tearDownModule():
    cell.close()


class Errors(unittest.TestCase):
    def test_they_are_those_of_hordctl(self):
        text = cell.write("text.png", "no image")
        typo = cell.write("typo.toml", "schema = 1\n[limits]\nemd_bin = 1\n")
        for arguments, call, kind in (
            ([cell.path("none.png")], lambda: hord.inspect(cell.path("none.png")), hord.NotFound),
            ([text], lambda: hord.inspect(text), hord.Error),
            ([lens, "--recipe", typo], lambda: hord.inspect(lens, recipe=typo), hord.InvalidArgument),
            ([lens, "--grid", typo], lambda: hord.inspect(lens, grid=typo), hord.InvalidArgument),
        ):
            with self.assertRaises(kind) as caught:
                call()
            error = caught.exception
            status, _, said = hordctl("inspect", *arguments)
            self.assertEqual(status, 2)
            if "--grid" not in arguments:
                self.assertEqual("hordctl: " + str(error), said.strip())
            self.assertEqual(str(error), f"{error.what}: {error.cure}" if error.cure else error.what)
        self.assertTrue(error.what)

    def test_a_frame_in_place_of_a_recipe_is_told_in_words_of_python(self):
        with self.assertRaisesRegex(hord.InvalidArgument, "is an image, .* hord.read, hord.inspect and hord.learn take frames$"):
            hord.inspect(bubble, recipe=bubble)

    def test_what_cannot_be_a_frame_is_refused(self):
        for array, words in (
            (np.zeros((90, 90)), "type float64 is not supported: give unsigned samples"),
            (np.zeros((9, 9, 3), np.uint8), "two dimensions, and this array 3"),
            (np.zeros((9, 9, 9, 9), np.uint8), "give samples .* to hord.from_samples"),
            (np.zeros((97, 90), np.uint8), "macro-pixels of 9x9 do not divide a frame of 90x97"),
            (np.zeros((0, 0), np.uint8), ""),
        ):
            with self.assertRaisesRegex(hord.InvalidArgument, words):
                hord.decode(array)
        frame = np.zeros((90, 90), np.uint8)
        for arguments in {"bins": "9by9"}, {"bins": (2, 9)}, {"bins": (2**40, 9)}, {"bins": [9, 10**400]}, {"bits": 12}:
            with self.assertRaises(hord.InvalidArgument):
                hord.decode(frame, **arguments)
        with self.assertRaises(TypeError):
            hord.decode(frame, bins=9)
        field = hord.decode(frame)
        for call in (lambda: field.feature("emdd"), lambda: field.feature("reference-emd"), lambda: field.feature("emd", threads=0),
                     lambda: hord.inspect(field, maps="some"), lambda: hord.distance("transmission", frame[:9, :9], frame[:9, :9])):
            with self.assertRaises(hord.InvalidArgument):
                call()

    def test_what_is_no_path_is_named(self):
        field = hord.decode(np.zeros((90, 90), np.uint8))
        for call, words in (
            (lambda: hord.inspect(3), "a frame is a LightField, an array or the path of a file, not int"),
            (lambda: hord.inspect(field, recipe=bytearray(b"a")), "a recipe is a Recipe or the path of its file, not bytearray"),
            (lambda: hord.inspect(field, reference=1.5), "a reference is .* not float"),
            (lambda: hord.decode(np.zeros((90, 90), np.uint8), grid=[]), "a grid is .* not list"),
        ):
            with self.assertRaisesRegex(TypeError, words):
                call()

    def test_a_distance_takes_whole_masses(self):
        """Shares would be cut to 0, and their distance would be 0."""
        hords = hord.read(bubble).hords()
        a, b = hords.masses[20, 19], hords.masses[20, 21]
        expected = hord.distance("emd", a, b)
        self.assertGreater(expected, 0)
        self.assertEqual(hord.distance("emd", a.astype(np.int64), b.astype(np.uint8)), expected)
        for wrong, words in (
            (hords.shares()[20, 19], "type float64 is not supported: give whole masses"),
            (a.astype(int) - 1000, "below 0"),
            (a.astype(int) * 70000, "above 65535"),
        ):
            with self.assertRaisesRegex(hord.InvalidArgument, words):
                hord.distance("emd", wrong, b)
        with self.assertRaisesRegex(hord.InvalidArgument, "use one of emd, .*, cramer-von-mises, max-sliced$"):
            hord.distance("transmission", a, b)

    def test_a_hord_without_light_has_no_distance(self):
        dark, lit = np.zeros((9, 9), np.uint16), np.ones((9, 9), np.uint16)
        for pair in (dark, lit), (lit, dark), (dark, dark):
            for name in "emd", "hellinger", "max-sliced":
                self.assertTrue(np.isnan(hord.distance(name, *pair)))
        self.assertEqual(hord.distance("emd", lit, lit), 0)

    def test_names_that_are_not_utf_8_are_escaped(self):
        with self.assertRaisesRegex(hord.NotFound, r"gr\\xe9n\.png does not exist"):
            hord.inspect(cell.path("gr\udce9n.png"))
        bad = pathlib.Path(cell.path("r\udce9c.toml"))
        bad.write_text("nothing = 1\n")
        with self.assertRaisesRegex(hord.InvalidArgument, r"r\\xe9c\.toml"):
            hord.Inspector(recipe=bad)
        odd = pathlib.Path(cell.path("gr\udce9n.pgm"))
        odd.write_bytes(b"P5\n90 63\n255\n" + bytes(90 * 63))
        self.assertEqual(hord.read(odd).source, str(odd))

    def test_an_image_is_no_reference(self):
        with self.assertRaisesRegex(hord.InvalidArgument, "is an image, and a learned reference is needed"):
            hord.inspect(lens, reference=bubble)

    def test_sensor_numbers_that_are_not_possible_are_refused_before_frames_are_read(self):
        for numbers in {"read_dn": -1}, {"read_dn": float("nan")}, {"read_dn": float("inf")}, {"electrons_per_dn": 0}, {"pedestal_dn": -1}:
            with self.assertRaisesRegex(hord.InvalidArgument, f"^{list(numbers)[0]}=.* is not possible: give "):
                hord.learn(["none.png"] * 8, **numbers)

    def test_without_numpy_the_import_names_its_package(self):
        code = "import importlib.util as u; f = u.find_spec; u.find_spec = lambda n, p=None: None if n == 'numpy' else f(n, p); import hord"
        said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertIn("ImportError: hord needs NumPy", said.stderr)
        self.assertIn("python3-numpy", said.stderr)

    def test_an_empty_path_is_not_an_argument_that_is_not_given(self):
        things = hord.read(lens), hord.learn(cell.good_parts(8), electrons_per_dn=10, read_dn=0.6).reference, hord.calibrate(white_frame())
        files = hord.read, hord.Recipe.load, hord.Reference.load, hord.Calibration.load, *(thing.save for thing in things)
        for call in (lambda: hord.inspect(lens, recipe=""), lambda: hord.inspect(lens, reference=""),
                     lambda: hord.decode(pixels(lens), grid=""), lambda: hord.Inspector(recipe=""), lambda: hord.inspect(""),
                     lambda: hord.inspect(b""), *(functools.partial(file, empty) for file in files for empty in ("", b""))):
            with self.assertRaisesRegex(hord.InvalidArgument, "this path is empty: is a variable of the script not set"):
                call()

    def test_a_path_may_be_bytes(self):
        frame, saved, recipe, reference = (os.fsencode(cell.path(name)) for name in ("b.png", "b.toml", "c.toml", "b.hordref"))
        hord.read(os.fsencode(lens)).save(frame)
        calibration = hord.calibrate(white_frame())  # it holds the time at which it was made
        calibration.save(saved)
        self.assertEqual(hord.Calibration.load(saved).toml(), calibration.toml())
        learned = hord.learn([os.fsencode(part) for part in cell.good_parts(8)], electrons_per_dn=10, read_dn=0.6).reference
        learned.save(reference)
        self.assertEqual(hord.Reference.load(reference).parts, learned.parts)
        pathlib.Path(os.fsdecode(recipe)).write_text(hord.Recipe().toml())
        self.assertEqual(hord.Recipe.load(recipe).crc32, hord.Recipe().crc32)
        for path in str, os.fsencode:
            self.assertEqual(hord.inspect(path(lens), recipe=recipe, reference=reference).score,
                             hord.inspect(hord.read(frame), hord.Recipe(), learned).score)
        with self.assertRaisesRegex(hord.NotFound, r"gr\\xe9n\.png does not exist"):
            hord.inspect(b"gr\xe9n.png")
        with self.assertRaisesRegex(hord.InvalidArgument, "holds a NUL character"):
            hord.read(b"g1\0.png")

    def test_what_does_not_exist_is_not_found(self):
        field = hord.decode(np.zeros((90, 90), np.uint8))
        none = cell.path("none")
        for call in (lambda: hord.read(none), lambda: hord.inspect(none), lambda: hord.learn([none] * 8), lambda: hord.Recipe.load(none),
                     lambda: hord.inspect(field, recipe=none), lambda: hord.Reference.load(none), lambda: hord.inspect(field, reference=none),
                     lambda: hord.Calibration.load(none), lambda: hord.decode(np.zeros((90, 90), np.uint8), grid=none),
                     lambda: field.save(cell.path("none/x.png"))):
            with self.assertRaises(hord.NotFound) as caught:
                call()
            self.assertTrue(caught.exception.cure, caught.exception)
        for load in hord.Reference.load, hord.Calibration.load, hord.read:
            with self.assertRaises(hord.Unreadable):
                load(cell.path("."))
        for load in hord.Reference.load, hord.Calibration.load, hord.read:
            with self.assertRaises(hord.Error) as caught:
                load(cell.write("text", "no such file"))
            self.assertNotIsInstance(caught.exception, (hord.NotFound, hord.InvalidArgument))

    def test_what_is_saved_into_no_folder_names_the_folder(self):
        learned = hord.learn(cell.good_parts(8), electrons_per_dn=10, read_dn=0.6).reference
        for thing in hord.decode(np.zeros((90, 90), np.uint8)), learned, hord.calibrate(white_frame()):
            with self.assertRaisesRegex(hord.NotFound, "^the folder .*/none does not exist: create it first$"):
                thing.save(cell.path("none/x"))

    def test_a_reference_of_other_frames_is_named_not_the_recipe(self):
        learned = hord.learn(cell.good_parts(8), electrons_per_dn=10, read_dn=0.6).reference
        for call in hord.inspect, hord.compare:
            with self.assertRaisesRegex(hord.InvalidArgument, "^the reference was learned from .* lenslets of 9x9 bins, the frames have 10x10 .*: give the reference that was"):
                call(np.zeros((90, 90), np.uint8), reference=learned)

    def test_impossible_threads_and_paths_are_refused_at_once(self):
        for threads in -1, 0, 65, 10**6:
            with self.assertRaisesRegex(hord.InvalidArgument, f"^threads={threads} is not possible: use 1 to 64$"):
                hord.Inspector(threads=threads)
        for call in (hord.read, hord.inspect, hord.Recipe.load, hord.Reference.load, hord.decode(np.zeros((90, 90), np.uint8)).save,
                     lambda path: hord.inspect(lens, recipe=path), lambda path: hord.inspect(lens, reference=pathlib.Path(path))):
            with self.assertRaisesRegex(hord.InvalidArgument, r"^the path 'g1.x00\.png' holds a NUL character: no file has such a name$"):
                call("g1\0.png")

    def test_arguments_that_do_not_fit_are_named(self):
        frame = np.zeros((90, 90), np.uint8)
        field = hord.decode(frame)
        for call, words in (
            (lambda: hord.read(3), "^hord.read: file is the path of a file, not int$"),
            (lambda: hord.decode([[1, 2], [3, 4]]), "^hord.decode: frame is a NumPy array, not list$"),
            (lambda: hord.decode(frame, bin=(9, 9)), r"^hord.decode has no argument bin: did you mean bins\?$"),
            (lambda: hord.decode(frame, bits="8"), "^hord.decode: bits is a whole number, not str$"),
            (lambda: hord.inspect(), r"^hord.inspect: missing a required argument: 'frame': see help\(hord.inspect\)$"),
            (lambda: hord.inspect(field, None, None, None, None, 0, 1, "judged", 4), "^hord.inspect: too many positional arguments"),
            (lambda: field.feature(3), "^hord.LightField.feature: name is a text, not int$"),
            (lambda: field.hords(dark_dn=-1), "^hord.LightField.hords: dark_dn cannot be -1$"),
            (lambda: field.deflection(dark_dn="x"), "dark_dn is a whole number, not str$"),
            (lambda: hord.learn([frame] * 8, read_dn="x"), "^hord.learn: read_dn is a number, not str$"),
            (lambda: hord.distance("emd", 3, frame), "^hord.distance: a is a NumPy array, not int$"),
            (lambda: hord.calibrate("white.png"), r"^hord.calibrate: white is a NumPy array, not str: read the file first, for example numpy.asarray\(PIL.Image.open\(file\)\)$"),
            (lambda: hord.calibrate(frame, tilts=[frame]), r"^hord.calibrate: tilts is a list of \(array, number, number\)$"),
            (lambda: hord.Inspector(threads="2"), "^hord.Inspector: threads is a whole number, not str$"),
            (lambda: hord.Recipe("lens.toml"), "^hord.Recipe: too many positional arguments"),
            (lambda: hord.Recipe.parse(3), "^hord.Recipe.parse: text is a text, not int$"),
            (lambda: hord.LightField(), r"^a LightField is not made by hand: see help\(hord.LightField\)$"),
            (lambda: hord.learn("good"), "^hord.learn: frames is a list of .*, not str: give for example sorted"),
            (lambda: hord.learn(pathlib.Path("good")), "^hord.learn: frames is a list"),
            (lambda: hord.learn(frame), "^hord.learn: frames is a list of .*, not ndarray"),
            (lambda: hord.learn(3), "^hord.learn: frames is a list of .*, not int"),
        ):
            with self.assertRaisesRegex(TypeError, words):
                call()

    def test_options_have_the_names_of_arguments(self):
        noise = np.random.default_rng(1).integers(20, 100, (90, 90)).astype(np.uint8)
        with self.assertRaisesRegex(hord.InvalidArgument, "in DN, with read_dn$"):
            hord.learn(noise for _ in range(8))
        recipe = cell.write("kind.toml", 'schema = 1\nname = "a"\nnumber = 7\n[limits]\nemd_bins = 1.0\n')
        with self.assertRaisesRegex(hord.Unreadable, "kind.toml is a recipe, and an image is needed: give it as recipe, or name"):
            hord.read(recipe)

    def test_help_shows_the_arguments(self):
        self.assertEqual(list(inspect.signature(hord.decode).parameters), ["frame", "bins", "grid", "bits"])
        self.assertEqual(inspect.signature(hord.inspect).parameters["maps"].default, "judged")

if __name__ == "__main__":
    unittest.main()
