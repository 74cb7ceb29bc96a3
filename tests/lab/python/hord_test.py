"""`import hord` against NumPy's own arithmetic, and against hordctl on the same frames: the same bits."""
import ctypes, functools, inspect, operator, sys, threading, unittest

import numpy as np

import hord
from cell import BUBBLE, Cell, hordctl, inspected, pixels, white_frame


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


if __name__ == "__main__":
    unittest.main()
