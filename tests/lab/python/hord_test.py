"""`import hord` against NumPy's own arithmetic, and against hordctl on the same frames: the same bits."""
import ctypes, functools, inspect, operator, os, pathlib, subprocess, sys, threading, unittest

import numpy as np

import hord
from cell import BUBBLE, Cell, hordctl, inspected, pixels


def setUpModule():
    global cell, lens, bubble
    cell = Cell()
    lens, bubble = cell.render("lens"), cell.render("bubble", BUBBLE)


def tearDownModule():
    cell.close()


# What hordctl --json says, without files and times, which are not the module's.
def of_frame(said):
    told = {key: value for key, value in said.items() if key not in ("frame", "grid_from", "calibration", "ms")}
    return {**told, "recipe": {key: value for key, value in said["recipe"].items() if key != "file"}}


class LightField(unittest.TestCase):
    def test_a_macro_pixel_frame_is_not_copied(self):
        frame = pixels(bubble)
        field = hord.decode(frame, bins=(9, 9))
        self.assertEqual(field.shape, (45, 45, 9, 9))
        self.assertTrue(np.shares_memory(field.samples, frame))
        self.assertEqual(field.samples[20, 30, 2, 5], frame[20 * 9 + 2, 30 * 9 + 5])
        with self.assertRaises(ValueError):
            field.samples[0, 0, 0, 0] = 1

    def test_rows_with_padding_are_not_copied_and_others_are(self):
        frame = pixels(bubble)
        padded = np.zeros((frame.shape[0], frame.shape[1] + 13), np.uint8)
        padded[:, :-13] = frame
        inside = hord.decode(padded[:, :-13])
        self.assertTrue(np.shares_memory(inside.samples, padded))
        turned = hord.decode(np.asfortranarray(frame))
        for field in inside, turned:
            np.testing.assert_array_equal(field.samples, hord.decode(frame).samples)
            self.assertEqual(hord.inspect(field).score, hord.inspect(bubble).score)

    def test_big_endian_samples_are_copied(self):
        frame = pixels(cell.render("deep", BUBBLE, bits=12)).astype(np.uint16)
        field = hord.decode(frame.astype(">u2"), bits=12)
        np.testing.assert_array_equal(field.samples, hord.decode(frame, bits=12).samples)
        self.assertEqual(field.samples.dtype, np.dtype(np.uint16))
        again = hord.from_samples(hord.decode(frame, bits=12).samples.astype(">u2"), bits=12)
        np.testing.assert_array_equal(again.samples, field.samples)

    def test_samples_lead_back_to_the_field(self):
        field = hord.read(bubble)
        again = hord.from_samples(field.samples)
        self.assertTrue(np.shares_memory(again.samples, field.samples))
        of_a_copy = hord.from_samples(np.ascontiguousarray(field.samples))
        np.testing.assert_array_equal(of_a_copy.frame, field.frame)

    def test_what_is_read_cannot_be_changed(self):
        field = hord.read(bubble)
        for view in field.samples, field.frame, field.samples.base, hord.decode(pixels(bubble)[:, ::-1]).samples:
            with self.assertRaises(ValueError):
                view[...] = 0
            with self.assertRaises(ValueError):
                view.flags.writeable = True

    def test_the_memory_outlives_the_frame(self):
        samples = hord.read(bubble).samples
        np.testing.assert_array_equal(samples, hord.decode(pixels(bubble)).samples)

    def test_sixteen_bits(self):
        frame = pixels(cell.render("deep", BUBBLE, bits=12)).astype(np.uint16)
        with self.assertRaisesRegex(hord.InvalidArgument, "largest of 10 bits is 1023: give the bits"):
            hord.decode(frame, bits=10)
        field = hord.decode(frame, bits=12)
        self.assertEqual(of_frame(inspected(cell.path("deep.png"))), of_frame(hord.inspect(field).to_dict()))
        frame[100, 100] = 65535  # written to after decode() had looked
        with self.assertRaisesRegex(hord.InvalidArgument, "a sample reads 65535"):
            hord.inspect(field)

    def test_a_saved_field_is_read_by_hordctl(self):
        field = hord.read(bubble)
        field.save(cell.path("saved.png"))
        self.assertEqual(of_frame(inspected(bubble)), of_frame(inspected(cell.path("saved.png"))))


class Features(unittest.TestCase):
    def test_hords_are_those_of_the_definition(self):
        field = hord.read(bubble)
        hords = field.hords(dark_dn=3)
        masses = np.maximum(field.samples.astype(int) - 3, 0)
        np.testing.assert_array_equal(hords.masses, masses)
        np.testing.assert_array_equal(hords.sums, masses.sum(axis=(2, 3)))
        lit = hords.mask == 0
        self.assertTrue(lit.sum() > 1000)
        np.testing.assert_allclose(hords.shares()[lit].sum(axis=(1, 2)), 1, rtol=1e-12)
        self.assertTrue((hords.shares()[~lit] == 0).all())
        bins = np.arange(9) - 4.0
        x = (hords.shares().sum(axis=2) * bins).sum(axis=2)
        given_x, given_y, mask = field.deflection(dark_dn=3)
        np.testing.assert_array_equal(mask, hords.mask)
        np.testing.assert_allclose(given_x[lit], x[lit], atol=2**-23)
        self.assertTrue(np.isnan(given_y[mask & (hord.DARK | hord.SATURATED) != 0]).all())

    def test_every_feature_is_that_of_hordctl_to_the_bit(self):
        field = hord.read(bubble)
        for name in hord.FEATURES:
            if name == "transmission":
                continue  # of the whole field here: the next test
            hordctl("inspect", bubble, "--feature", name, "--out", cell.path("maps"))
            tiff = pixels(cell.path(f"maps/bubble.{name}.tiff"))
            map = field.feature(name)
            np.testing.assert_array_equal(map.filled, tiff, err_msg=name)
            self.assertTrue(map.valid.any() and not map.valid.all(), name)
            np.testing.assert_array_equal(np.isnan(map.filled), ~map.valid)

    def test_a_distance_against_a_good_part_is_that_of_hordctl(self):
        hordctl("inspect", bubble, "--feature", "reference-chi2", "--reference", lens, "--out", cell.path("maps"))
        map = hord.read(bubble).feature("reference-chi2", reference=hord.read(lens), threads=2)
        np.testing.assert_array_equal(map.filled, pixels(cell.path("maps/bubble.reference-chi2.tiff")))

    def test_transmission_is_light_over_the_typical_lenslets(self):
        field = hord.read(bubble)
        map = field.feature("transmission")
        sums = field.hords().sums
        typical = np.sort(sums[field.hords().mask == 0])
        ratio = map.values[map.valid & (sums > 0)] / sums[map.valid & (sums > 0)]
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)
        self.assertTrue(typical[0] <= 1 / ratio[0] <= typical[-1])

    def test_one_pair_is_the_map_of_two_neighbours(self):
        field = hord.read(bubble)
        hords, map = field.hords(), field.feature("emd")
        n, m = 22, 20
        self.assertEqual(map.mask[n, m], 0)
        x = hord.distance("emd", hords.masses[n, m - 1], hords.masses[n, m + 1])
        y = hord.distance("emd", hords.masses[n - 1, m], hords.masses[n + 1, m])
        self.assertAlmostEqual(map.values[n, m], np.hypot(x, y), places=5)
        one, two = np.zeros((9, 9), np.uint16), np.zeros((9, 9), np.uint16)
        one[4, 1], two[4, 6] = 100, 50
        self.assertEqual(hord.distance("emd", one, two), 5.0)


class Inspect(unittest.TestCase):
    def test_verdicts_are_those_of_hordctl_to_the_bit(self):
        verdicts = set()
        for name, defects in (("lens", ""), ("bubble", BUBBLE), ("none", '[[defect]]\nkind = "bubble"\ncentre_mm = [0, 0, 0]\nradius_mm = 6\n')):
            frame = cell.render(name, defects)
            found = hord.inspect(frame)
            self.assertEqual(of_frame(found.to_dict()), of_frame(inspected(frame)), name)
            verdicts.add(found.verdict)
        blank = hord.inspect(np.zeros((405, 405), np.uint8))
        self.assertEqual((blank.verdict, blank.reason), ("unfit", "too-dark"))
        self.assertTrue({"pass", "reject"} <= verdicts, verdicts)

    def test_a_recipe_counts_and_is_the_same_recipe(self):
        recipe = cell.write("strict.toml", 'schema = 1\nname = "strict"\nnumber = 7\n[limits]\nemd_bins = 0.05\nfrobenius_bins = 0.05\n')
        said = inspected(lens, "--recipe", recipe)
        inspector = hord.Inspector(recipe=hord.Recipe.load(recipe), threads=2)
        self.assertEqual(of_frame(inspector.inspect(lens).to_dict()), of_frame(said))
        self.assertEqual((inspector.recipe.number, inspector.recipe.crc32), (7, said["recipe"]["crc32"]))
        self.assertEqual(hord.Recipe.parse(inspector.recipe.toml()).crc32, said["recipe"]["crc32"])
        self.assertEqual(hord.Recipe().crc32, inspected(lens)["recipe"]["crc32"])

    def test_maps_are_those_of_hordctl(self):
        found = hord.inspect(bubble, maps="all")
        for name in "emd", "jacobian-frobenius", "transmission", "anisotropy", "sums":
            hordctl("inspect", bubble, "--feature", name, "--out", cell.path("maps"))
            np.testing.assert_array_equal(found.maps[name].filled, pixels(cell.path(f"maps/bubble.{name}.tiff")), err_msg=name)
        self.assertIn(found.decided_by, found.maps)
        self.assertTrue((found.maps["emd"].mask & hord.OUTSIDE).any())
        self.assertFalse(found.maps["emd"].bounds)
        self.assertTrue(hord.inspect(bubble).maps["emd"].bounds)


class Learning(unittest.TestCase):
    def test_a_reference_and_its_verdicts_are_those_of_hordctl(self):
        good = cell.good_parts(9)
        file = cell.path("lens.hordref")
        self.assertEqual(hordctl("learn", *good, "--out", file)[0], 0)
        learned = hord.learn(good)
        learned.reference.save(cell.path("own.hordref"))
        with open(file, "rb") as a, open(cell.path("own.hordref"), "rb") as b:
            self.assertEqual(a.read(), b.read())
        self.assertEqual((learned.reference.parts, learned.left_out, len(learned.poses)), (9, [], 9))
        for frame in lens, bubble:
            found = hord.inspect(frame, reference=learned.reference)
            self.assertEqual(of_frame(found.to_dict()), of_frame(inspected(frame, "--reference", file)))
            self.assertIn("z-score", found.maps)
        self.assertEqual(found.verdict, "reject")

        compared = hord.compare(bubble, file)
        self.assertTrue(compared.found)
        worst = np.unravel_index(np.nanargmin(compared.light), compared.light.shape)
        self.assertLess(compared.light[worst], -0.3)
        defect = found.defects[0]
        self.assertLess(np.hypot(worst[1] - defect["m"], worst[0] - defect["n"]), 3)
        # The worst of the four scores is the map that the verdict used; missing light has a deviance of its own.
        z = found.maps["z-score"]
        quiet = z.judged & (compared.scores[0] > -6) & compared.has_light
        worst_of = np.maximum.reduce([abs(compared.scores[0]), compared.scores[1], abs(compared.scores[2]), compared.scores[3]])
        np.testing.assert_array_equal(worst_of[quiet], z.values[quiet])
        self.assertTrue(quiet.sum() > 1000)

        reference = hord.Reference.load(file)
        np.testing.assert_allclose(reference.hords().sum(axis=(2, 3))[reference.mask == 0], 1, atol=81 / 2**15)
        self.assertEqual(reference.shape, (45, 45, 9, 9))
        with self.assertRaises(ValueError):
            reference.light[0, 0] = 0

    def test_copies_of_a_bad_part_do_not_support_each_other(self):
        good, bad = cell.good_parts(9), cell.render("bad", BUBBLE, seed=7)
        learned = hord.learn([bad, *good, bad, bad])
        self.assertEqual(learned.reference.parts, 9)
        self.assertEqual([part for part, _ in learned.left_out], [0, 10, 11])
        self.assertIn("the same part as an earlier frame", learned.left_out[1][1])

    def test_too_few_parts_are_refused(self):
        with self.assertRaises(hord.InvalidArgument) as caught:
            hord.learn([lens] * 3)
        self.assertIn("3 frames show 1 distinct part", str(caught.exception))
        self.assertIn("at least 7 more", str(caught.exception))
        self.assertEqual(str(caught.exception), hordctl("learn", lens, lens, lens, "--out", cell.path("few.hordref"))[2].strip().splitlines()[-1].removeprefix("hordctl: "))


def white_frame(pitch=12.4, turn=0.004, side=400):
    y, x = np.mgrid[0:side, 0:side]
    u = ((x - side / 2) * np.cos(turn) + (y - side / 2) * np.sin(turn)) / pitch
    v = ((y - side / 2) * np.cos(turn) - (x - side / 2) * np.sin(turn)) / pitch
    r2 = (u - np.round(u)) ** 2 + (v - np.round(v)) ** 2
    return (20 + 200 * np.exp(-r2 / (2 * 0.16**2))).astype(np.uint8)


class Calibrate(unittest.TestCase):
    def test_a_white_frame_gives_the_grid_of_hordctl(self):
        from PIL import Image

        white = white_frame()
        Image.fromarray(white).save(cell.path("white.png"))
        status, _, error = hordctl("calibrate", cell.path("white.png"), "--out", cell.path("grid.toml"), "--centres", cell.path("centres.csv"))
        self.assertEqual(status, 0, error)
        own, file = hord.calibrate(white, camera="test"), hord.Calibration.load(cell.path("grid.toml"))
        np.testing.assert_array_equal(own.centres, file.centres)
        self.assertAlmostEqual(own.pitch_px, 12.4, places=2)
        self.assertEqual((own.lattice, own.camera, own.frame_shape, own.has_directions), ("square", "test", (400, 400), False))
        for m, n, x, y in np.loadtxt(cell.path("centres.csv"), delimiter=",", skiprows=1)[::50]:
            np.testing.assert_allclose(own.centres[int(n), int(m)], (x, y), atol=1e-3)
        own.save(cell.path("own.toml"))
        self.assertEqual(hord.Calibration.load(cell.path("own.toml")).toml(), own.toml())

        field = hord.decode(white, bins="7x7", grid=own)
        self.assertEqual(field.shape[2:], (7, 7))
        said = inspected(cell.path("white.png"), "--grid", cell.path("grid.toml"), "--macro", "7x7")
        self.assertEqual((said["grid"]["n"], said["grid"]["m"]), field.shape[:2])
        self.assertEqual(of_frame(hord.inspect(field).to_dict()), of_frame(said))

    def test_a_frame_without_lenslets_is_refused_with_the_reason(self):
        with self.assertRaisesRegex(hord.Refused, "no lattice: .*: light the lenslets evenly"):
            hord.calibrate(np.full((90, 90), 64, np.uint8))


class Threads(unittest.TestCase):
    def test_two_threads_give_what_one_gives(self):
        alone = [hord.read(frame).feature("emd").values for frame in (lens, bubble)]
        results = {}

        def work(k, frame):
            inspector = hord.Inspector()
            for _ in range(5):
                results[k] = hord.read(frame).feature("emd").values
                results[k, "score"] = inspector.inspect(frame).score

        threads = [threading.Thread(target=work, args=pair) for pair in enumerate((lens, bubble))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for k in range(2):
            np.testing.assert_array_equal(results[k], alone[k])
        self.assertEqual((results[0, "score"], results[1, "score"]), (hord.inspect(lens).score, hord.inspect(bubble).score))

    def test_one_inspector_serves_two_threads_in_turn(self):
        inspector, scores = hord.Inspector(), []
        work = lambda: scores.extend(inspector.inspect(bubble).score for _ in range(20))
        threads = [threading.Thread(target=work) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(set(scores), {hord.inspect(bubble).score})
        self.assertEqual(len(scores), 40)

    def test_the_gil_is_released(self):
        field, good = hord.read(bubble), cell.good_parts(8)
        reference = hord.learn(good, electrons_per_dn=10, read_dn=0.6).reference
        white = white_frame()
        self.assertFalse(any(self.lets_another_run(sum, range(1000000)) for _ in range(20)), "a call that holds the GIL")
        for function, *arguments in (
            (hord.LightField.feature, field, "emd"), (hord.LightField.hords, field), (hord.LightField.deflection, field),
            (hord.inspect, field), (hord.compare, bubble, reference), (hord.learn, good), (hord.calibrate, white),
        ):
            compiled = inspect.getclosurevars(function).nonlocals["call"]  # hord/plain.py wraps it
            self.assertTrue(any(self.lets_another_run(compiled, *arguments) for _ in range(20)), f"{function} holds the GIL")

    def lets_another_run(self, function, *arguments):
        """Whether another thread runs Python in the middle of a call of a compiled function.

        The other one asks for the GIL before the call. It asked in vain for one switch interval: then the interpreter
        waits, where the GIL is released, until the other one has taken it, however busy the machine is. map() goes from
        one compiled function to the next without a look at who asks."""
        gate, marks = threading.Lock(), []
        gate.acquire()
        other = threading.Thread(target=lambda: (gate.acquire(), marks.append("other")))
        other.start()
        before = sys.getswitchinterval()
        try:
            list(map(operator.call, (
                gate.release, functools.partial(sys.setswitchinterval, 1e-4),
                functools.partial(ctypes.PyDLL(None).usleep, 100000),  # with the GIL: the other one asks for it
                functools.partial(sys.setswitchinterval, 100),  # and who has it keeps it
                functools.partial(marks.append, "begin"), functools.partial(function, *arguments),
                functools.partial(marks.append, "end"))))
        finally:
            sys.setswitchinterval(before)
        other.join()
        return marks == ["begin", "other", "end"]


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
