#!/usr/bin/env python3
"""The PLCopen XML of deploy/plc: it is what the text makes, and it keeps to the schema."""
import unittest
import xml.etree.ElementTree as ElementTree

import plc
import plcopen
import st

# What the schema (tc6_xml_v201.xsd) allows of what the generator writes: children in their order, required attributes.
VARIABLES = ("inputVars", "outputVars", "inOutVars", "localVars")
TYPES = ("BOOL", "WORD", "UINT", "UDINT", "TIME", "derived", "array", "struct")
SCHEMA = {
    "project": (["fileHeader", "contentHeader", "types", "instances"], []),
    "fileHeader": ([], ["companyName", "productName", "productVersion", "creationDateTime"]),
    "contentHeader": (["coordinateInfo"], ["name"]), "coordinateInfo": (["fbd", "ld", "sfc"], []),
    "fbd": (["scaling"], []), "ld": (["scaling"], []), "sfc": (["scaling"], []), "scaling": ([], ["x", "y"]),
    "types": (["dataTypes", "pous"], []), "dataTypes": (["dataType*"], []), "dataType": (["baseType"], ["name"]),
    "baseType": (["TYPE"], []), "type": (["TYPE"], []), "struct": (["variable*"], []), "array": (["dimension", "baseType"], []),
    "dimension": ([], ["lower", "upper"]), "derived": ([], ["name"]), "pous": (["pou*"], []),
    "pou": (["interface", "body"], ["name", "pouType"]), "interface": (["returnType?", "VARIABLES*", "documentation?"], []),
    "returnType": (["TYPE"], []), "variable": (["type", "initialValue?", "documentation?"], ["name"]),
    "initialValue": (["simpleValue"], []), "simpleValue": ([], ["value"]), "documentation": (["p"], []), "body": (["ST"], []),
    "ST": (["p"], []), "p": ([], []), "instances": (["configurations"], []), "configurations": ([], []),
}
for each in VARIABLES:
    SCHEMA[each] = (["variable*"], [])
for each in TYPES[:5]:
    SCHEMA[each] = ([], [])


class PlcOpen(unittest.TestCase):
    def test_the_xml_in_the_tree_is_what_the_text_makes(self):
        made = plcopen.project([plc.LIBRARY / name for name in plc.PARTS_OF_IT])
        self.assertEqual((plc.LIBRARY / "hord.xml").read_text(), made,
                         "run: cd deploy/plc && ../../tests/system/plc/plcopen.py hord_types.st hord_in_order.st hord_station.st > hord.xml")

    def check(self, element):
        space, name = element.tag[1:].split("}")
        self.assertEqual(space, "http://www.w3.org/1999/xhtml" if name == "p" else "http://www.plcopen.org/xml/tc6_0201", name)
        children, attributes = SCHEMA[name]
        for attribute in attributes:
            self.assertIn(attribute, element.attrib, name)
        rest = [child.tag.split("}")[1] for child in element]
        for child in children:
            names = {"TYPE": TYPES, "VARIABLES": VARIABLES}.get(child.rstrip("?*"), (child.rstrip("?*"),))
            count = 0
            while rest and rest[0] in names and (count == 0 or child.endswith("*")):
                rest.pop(0)
                count += 1
            self.assertTrue(count or child[-1] in "?*", f"{name} without {child}")
        self.assertEqual(rest, [], name)
        for child in element:
            self.check(child)

    def test_the_xml_has_the_schema_s_elements_in_its_order(self):
        self.check(ElementTree.parse(plc.LIBRARY / "hord.xml").getroot())

    def test_every_body_is_in_the_xml_as_it_is_in_the_text(self):
        library = st.Library()
        for name in plc.PARTS_OF_IT:
            library.add((plc.LIBRARY / name).read_text(), name)
        space = {"t": "http://www.plcopen.org/xml/tc6_0201"}
        found = {}
        for pou in ElementTree.parse(plc.LIBRARY / "hord.xml").getroot().iterfind(".//t:pou", space):
            found[pou.get("name")] = [token[1] for token in st.tokens_of("".join(pou.find("t:body", space).itertext()), "xml")]
        for name, unit in library.units.items():
            if name != "TON":
                self.assertEqual(found[name], [token[1] for token in st.tokens_of(unit.text, name)], name)

    def test_the_page_s_example_is_the_one_that_was_run(self):
        example = (plc.LIBRARY / "hord_example.st").read_text()
        self.assertIn("```\n" + example[example.index("PROGRAM Line"):] + "```\n", (plc.ROOT / "docs/plc.md").read_text())

    def test_lines_are_short_enough_for_a_plc_s_editor(self):
        for name in [*plc.PARTS_OF_IT, "hord_example.st"]:
            for number, line in enumerate((plc.LIBRARY / name).read_text().splitlines(), 1):
                self.assertLessEqual(len(line), 120, f"{name}:{number}")


if __name__ == "__main__":
    unittest.main()
