"""hordctl export and import, with the libraries that other programs use."""
import hashlib, json, os, struct, unittest

import h5py
import numpy as np
from PIL import Image

from cell import BUBBLE, Cell, hordctl, inspected, pixels


def setUpModule():
    global cell, bubble, samples
    cell = Cell()
    bubble = cell.render("bubble", BUBBLE)
    samples = pixels(bubble).reshape(45, 9, 45, 9).transpose(0, 2, 1, 3)  # [n, m, j, i]


def tearDownModule():
    cell.close()


def of_frame(frame, *more):
    said = inspected(frame, *more)
    return {key: said[key] for key in ("verdict", "reason", "score", "defects", "light", "grid")}


class Export(unittest.TestCase):
    def export(self, name, *arguments):
        status, said, error = hordctl("export", bubble, "--out", cell.path(name), *arguments)
        self.assertEqual(status, 0, error)
        maps = [file for file in os.listdir(cell.path(name)) if ".mask." not in file and ".light_field." not in file]
        form = arguments[-1] if "--format" in arguments else "npy"
        self.assertRegex(said, rf"^{bubble}: a light field and \d+ maps with masks: {cell.path(name)}/bubble\.{'h5' if form == 'hdf5' else f'[*].{form}'}\n$")
        if form != "hdf5":
            self.assertIn(f" {len(maps)} maps", said)
        return lambda file: os.path.join(cell.path(name), file)

    def test_numpy_reads_what_inspect_writes_as_tiff(self):
        at = self.export("npy", "--feature", "marginal")
        np.testing.assert_array_equal(np.load(at("bubble.light_field.npy")), samples)
        for name in "emd", "jacobian-frobenius", "transmission", "sums":
            hordctl("inspect", bubble, "--feature", name, "--out", cell.path("maps"))
            np.testing.assert_array_equal(np.load(at(f"bubble.{name}.npy")), pixels(cell.path(f"maps/bubble.{name}.tiff")))
            np.testing.assert_array_equal(np.load(at(f"bubble.{name}.mask.npy")), pixels(cell.path("maps/bubble.mask.png")))
        hordctl("inspect", bubble, "--feature", "marginal", "--out", cell.path("maps"))
        np.testing.assert_array_equal(np.load(at("bubble.marginal.npy")), pixels(cell.path("maps/bubble.marginal.tiff")))

    def test_tiff(self):
        at, npy = self.export("tiff", "--format", "tiff"), self.export("npy2")
        np.testing.assert_array_equal(pixels(at("bubble.light_field.tiff")), pixels(bubble))
        np.testing.assert_array_equal(pixels(at("bubble.emd.tiff")), np.load(npy("bubble.emd.npy")))
        np.testing.assert_array_equal(pixels(at("bubble.emd.mask.tiff")), np.load(npy("bubble.emd.mask.npy")))
        self.assertEqual(of_frame(at("bubble.light_field.tiff")), of_frame(bubble), "hordctl reads it, too")

    def test_hdf5(self):
        at, npy = self.export("hdf5", "--format", "hdf5"), self.export("npy3")
        with h5py.File(at("bubble.h5")) as file:
            np.testing.assert_array_equal(file["light_field"], samples)
            self.assertEqual(set(file["maps"]), set(file["masks"]))
            for name in file["maps"]:
                np.testing.assert_array_equal(file["maps"][name], np.load(npy(f"bubble.{name}.npy")), err_msg=name)
                np.testing.assert_array_equal(file["masks"][name], np.load(npy(f"bubble.{name}.mask.npy")), err_msg=name)
            text = lambda value: value.decode() if isinstance(value, bytes) else value
            self.assertEqual(text(file["maps/emd"].attrs["unit"]), "bin pitches")
            self.assertEqual(json.loads(text(file.attrs["inspection"]))["verdict"], "reject")

    def test_maps_in_dioptres_are_those_of_inspect(self):
        status, _, error = hordctl("export", bubble, "--out", cell.path("power"), "--feature", "optical-power")
        self.assertEqual(status, 2)
        self.assertIn("use hordctl inspect FRAME --feature optical-power", error)

    def test_sixteen_bits_and_maps_alone(self):
        deep = cell.render("deep", BUBBLE, bits=12)
        status, _, error = hordctl("export", deep, "--out", cell.path("deep"))
        self.assertEqual(status, 0, error)
        field = np.load(os.path.join(cell.path("deep"), "deep.light_field.npy"))
        self.assertEqual(field.dtype, np.uint16)
        np.testing.assert_array_equal(field.transpose(0, 2, 1, 3).reshape(405, 405), pixels(deep))
        hordctl("export", deep, "--out", cell.path("maps-alone"), "--no-light-field", "--format", "hdf5")
        with h5py.File(os.path.join(cell.path("maps-alone"), "deep.h5")) as file:
            self.assertEqual(set(file), {"maps", "masks"})


class Import(unittest.TestCase):
    def back(self, source):
        out = source.rstrip("/") + ".imported.png"
        status, said, error = hordctl("import", source, "--out", out)
        self.assertEqual(status, 0, error)
        return out, said

    def refused(self, source, words):
        status, _, error = hordctl("import", source, "--out", cell.path("refused.png"))
        self.assertEqual(status, 2)
        self.assertIn(words, error)
        self.assertEqual(error.count("\n"), 1, error)
        self.assertFalse(os.path.exists(cell.path("refused.png")))

    def test_what_was_exported(self):
        for form, name in ("npy", "bubble.light_field.npy"), ("hdf5", "bubble.h5"):
            hordctl("export", bubble, "--out", cell.path("there"), "--format", form)
            out, _ = self.back(os.path.join(cell.path("there"), name))
            self.assertEqual(of_frame(out), of_frame(bubble))

    def matlab(self, name, lf, head=b"MATLAB 7.3 MAT-file"):
        """LF(j, i, l, k, c) as MATLAB saves it: the dimensions reversed, behind 512 bytes of its own."""
        file = cell.path(name)
        with h5py.File(file, "w", userblock_size=512) as to:
            to["LF"] = lf.transpose(*reversed(range(lf.ndim)))
        with open(file, "r+b") as to:
            to.write(head.ljust(124) + struct.pack("<HH", 0x0200, 0x4D49))
        return file

    def test_a_light_field_of_lftoolbox(self):
        lf = samples.transpose(2, 3, 0, 1)  # (j, i, l, k): l along n, k along m
        out, said = self.back(self.matlab("grey.mat", lf))
        np.testing.assert_array_equal(pixels(out), pixels(bubble))
        self.assertIn("LFToolbox", said)
        colour = np.stack([lf // 2, lf, lf // 3, np.full_like(lf, 255)], axis=-1).astype(np.uint16) * 256
        out, said = self.back(self.matlab("colour.mat", colour))
        wide = colour.astype(int)
        mean = (wide[..., 0] + wide[..., 1] + wide[..., 2] + 1) // 3
        np.testing.assert_array_equal(pixels(out), mean.transpose(2, 0, 3, 1).reshape(405, 405))
        self.assertIn("the mean of red, green and blue", said)

    def test_matlab_files_that_are_not_read(self):
        lf = samples.transpose(2, 3, 0, 1)
        self.refused(self.matlab("single.mat", lf.astype(np.float32)), "LF holds no uint8 and no uint16: save samples as")
        self.refused(self.matlab("flat.mat", lf[0]), "LF has 3 dimensions")
        file = cell.path("old.mat")
        with open(file, "wb") as to:
            to.write(b"MATLAB 5.0 MAT-file".ljust(128) + bytes(64))
        self.refused(file, "is a MATLAB file of version 5 to 7: save it again in MATLAB with save(..., '-v7.3')")
        with open(self.matlab("cut.mat", lf), "r+b") as to:
            to.truncate(3000)
        self.refused(cell.path("cut.mat"), "cut.mat")

    def viewpoints(self, name, mode="L"):
        folder = cell.path(name)
        os.mkdir(folder)
        for j in range(9):
            for i in range(9):
                Image.fromarray(np.ascontiguousarray(samples[:, :, j, i])).convert(mode).save(os.path.join(folder, f"{j}_{i}.png"))
        return folder

    def test_viewpoints_of_plenopticam(self):
        folder = self.viewpoints("viewpoints_9px")
        out, said = self.back(folder)
        np.testing.assert_array_equal(pixels(out), pixels(bubble))
        self.assertIn("PlenoptiCam", said)
        os.remove(os.path.join(folder, "4_4.png"))
        self.refused(folder, "has 80 of 81 viewpoints")
        self.refused(self.viewpoints("coloured", "RGB"), "save the viewpoints as grey images, or as TIFF of red, green and blue")

    def colour_tiff(self, file, pixels):
        """[row, column, 3], 16 bits, one strip: what Pillow does not write."""
        data = pixels.astype("<u2").tobytes()
        height, width, _ = pixels.shape
        entries = [(256, 3, 1, width), (257, 3, 1, height), (258, 3, 3, 8), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 1, 14),
                   (277, 3, 1, 3), (278, 3, 1, height), (279, 4, 1, len(data)), (284, 3, 1, 1)]
        with open(file, "wb") as to:
            to.write(struct.pack("<2sHI3H", b"II", 42, 14 + len(data), 16, 16, 16) + data + struct.pack("<H", len(entries)))
            to.write(b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4))

    def test_viewpoints_of_plenopticam_in_colour(self):
        folder = cell.path("viewpoints_colour")
        os.mkdir(folder)
        wide = np.stack([samples.astype(np.uint16) * factor for factor in (100, 200, 255)], axis=-1)
        for j in range(9):
            for i in range(9):
                self.colour_tiff(os.path.join(folder, f"{j}_{i}.tiff"), wide[:, :, j, i])
        out, said = self.back(folder)
        mean = (wide.astype(int).sum(axis=-1) + 1) // 3
        np.testing.assert_array_equal(pixels(out), mean.transpose(0, 2, 1, 3).reshape(405, 405))
        self.assertIn("the mean of red, green and blue", said)
        with open(os.path.join(folder, "3_3.tiff"), "r+b") as file:
            file.truncate(2000)
        self.refused(folder, "3_3.tiff")

    def lytro(self, name, packed, image, width, height, cut=None, newer=False):
        """The container: sections with digests, a table of contents, metadata, packed samples."""
        def section(kind, data):
            digest = "sha1-" + hashlib.sha1(data).hexdigest()
            head = b"\x89LF" + kind + b"\r\n\x1a\n" + bytes(4) + struct.pack(">I", len(data)) + digest.encode() + bytes(35)
            return digest, head + data + bytes(-len(data) % 16)

        metadata = json.dumps({"image": {"width": width, "height": height, **image}}).encode()
        image_ref, image_section = section(b"C", packed)
        metadata_ref, metadata_section = section(b"C", metadata)
        frame = {"frame": {"imageRef": image_ref, "metadataRef": metadata_ref}}
        table = {"frames": [frame]} if newer else {"picture": {"frameArray": [frame]}}
        whole = b"\x89LFP\r\n\x1a\n" + struct.pack(">II", 1, 0) + section(b"M", json.dumps(table).encode())[1] + metadata_section + image_section
        with open(cell.path(name), "wb") as file:
            file.write(whole[:cut])
        return cell.path(name)

    def test_raw_frames_of_lytro_cameras(self):
        random = np.random.default_rng(1)
        frame = random.integers(0, 4096, (30, 40))
        flat = frame.reshape(-1, 2)
        packed = np.stack([flat[:, 0] >> 4, (flat[:, 0] & 15) << 4 | flat[:, 1] >> 8, flat[:, 1] & 255], axis=1).astype(np.uint8).tobytes()
        says = {"rawDetails": {"pixelPacking": {"bitsPerPixel": 12, "endianness": "big"}}}
        first = self.lytro("first.lfp", packed, says, 40, 30)
        out, said = self.back(first)
        np.testing.assert_array_equal(pixels(out), frame)
        self.assertIn("a raw frame of 12 bits, of Lytro's raw frame", said)
        self.assertIn("without --grid", hordctl("inspect", out)[2], "the frame says that it is raw")

        frame = random.integers(0, 1024, (30, 40))
        four = frame.reshape(-1, 4)
        low = four & 3
        packed = np.concatenate([four >> 2, (low[:, 0] | low[:, 1] << 2 | low[:, 2] << 4 | low[:, 3] << 6)[:, None]], axis=1).astype(np.uint8).tobytes()
        says = {"pixelPacking": {"bitsPerPixel": 10, "endianness": "little"}}
        out, _ = self.back(self.lytro("illum.lfr", packed, says, 40, 30, newer=True))
        np.testing.assert_array_equal(pixels(out), frame)

        self.refused(self.lytro("cut.lfp", packed, says, 40, 30, cut=600), "truncated or damaged")
        self.refused(self.lytro("small.lfp", packed[:-5], says, 40, 30), "samples are missing")
        self.refused(self.lytro("huge.lfp", packed, says, 60000, 60000), "a frame of 60000x60000 pixels")
        self.refused(self.lytro("other.lfp", packed, {"pixelPacking": {"bitsPerPixel": 14, "endianness": "big"}}, 40, 30), "packs 14 bits, big-endian: known are")
        self.refused(self.lytro("silent.lfp", packed, {}, 40, 30), "do not say how the samples are packed")

    def test_what_is_not_known(self):
        self.refused(bubble, "is no light field that is known: known are .npy and HDF5")
        self.refused(cell.path("none.mat"), "cannot be read (No such file or directory)")
        np.save(cell.path("fortran.npy"), np.asfortranarray(samples))
        self.refused(cell.path("fortran.npy"), "is in Fortran order: save numpy.ascontiguousarray() of it")
        np.save(cell.path("float.npy"), samples.astype(float))
        self.refused(cell.path("float.npy"), "holds no uint8 and no uint16")
        np.save(cell.path("big.npy"), samples.astype(">u2"))
        self.refused(cell.path("big.npy"), "holds big-endian uint16: save it as little-endian: array.astype('<u2')")
        os.mkdir(cell.path("empty"))
        self.refused(cell.path("empty"), "empty holds no viewpoint: give the folder of PlenoptiCam's viewpoints: images named J_I")
        np.save(cell.path("few.npy"), samples[:2])
        self.refused(cell.path("few.npy"), "few.npy")
        np.save(cell.path("three.npy"), samples[0])
        self.refused(cell.path("three.npy"), "has 3 dimensions: give samples [n, m, j, i]")
        np.save(cell.path("cut.npy"), np.ascontiguousarray(samples))
        with open(cell.path("cut.npy"), "r+b") as file:
            file.truncate(1000)
        self.refused(cell.path("cut.npy"), "is no .npy file, or is cut off")


if __name__ == "__main__":
    unittest.main()
