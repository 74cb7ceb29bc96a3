#!/usr/bin/env python3
"""Writes Structured Text as PLCopen XML (TC6, version 2.01): plcopen.py FILE.st ... > FILE.xml"""
import sys
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import st

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!-- Generated: tests/system/plc/plcopen.py hord_types.st hord_in_order.st hord_station.st > hord.xml. A test compares them. -->
<project xmlns="http://www.plcopen.org/xml/tc6_0201" xmlns:xhtml="http://www.w3.org/1999/xhtml">
  <fileHeader companyName="HORD station" productName="HORD station PLC library" productVersion="1" creationDateTime="2026-11-23T00:00:00"/>
  <contentHeader name="hord">
    <coordinateInfo>
      <fbd><scaling x="1" y="1"/></fbd>
      <ld><scaling x="1" y="1"/></ld>
      <sfc><scaling x="1" y="1"/></sfc>
    </coordinateInfo>
  </contentHeader>
"""
SECTIONS = {"VAR_INPUT": "inputVars", "VAR_OUTPUT": "outputVars", "VAR_IN_OUT": "inOutVars", "VAR": "localVars"}


def text(words):
    return f"<documentation><xhtml:p>{escape(words)}</xhtml:p></documentation>" if words else ""


def type_of(kind):
    if isinstance(kind, str):
        return f"<{kind}/>"
    if getattr(kind, "name", None):
        return f'<derived name="{kind.name}"/>'
    return array_of(kind)


def array_of(array):
    return f'<array><dimension lower="{array.low}" upper="{array.high}"/><baseType>{type_of(array.of)}</baseType></array>'


def value_of(kind, value):
    if kind == "TIME":
        return f"T#{value}ms"
    return str(value).upper() if kind == "BOOL" else str(value)


def variable(v):
    initial = "" if v.initial is None else f"<initialValue><simpleValue value={quoteattr(value_of(v.type, v.initial))}/></initialValue>"
    return f'          <variable name="{v.name}"><type>{type_of(v.type)}</type>{initial}{text(v.comment)}</variable>\n'


def data_type(name, kind):
    if isinstance(kind, st.Struct):
        members = "".join(f'          <variable name="{member}"><type>{type_of(of)}</type>{text(kind.comments[member])}</variable>\n'
                          for member, of in kind.members.items())
        base = f"<struct>\n{members}        </struct>"
    else:
        base = array_of(kind)
    return f'      <dataType name="{name}">\n        <baseType>{base}</baseType>\n      </dataType>\n'


def pou(unit):
    out = f'      <pou name="{unit.name}" pouType="{"functionBlock" if unit.what == "FUNCTION_BLOCK" else unit.what.lower()}">\n        <interface>\n'
    if unit.returns:
        out += f"          <returnType>{type_of(unit.returns)}</returnType>\n"
    groups = {}
    for v in unit.variables.values():
        groups.setdefault((SECTIONS[v.section], v.constant, v.retain), []).append(v)
    for (section, constant, retain), variables in groups.items():
        marks = ' constant="true"' * constant + ' retain="true"' * retain
        out += f"        <{section}{marks}>\n" + "".join(variable(v) for v in variables) + f"        </{section}>\n"
    if unit.comment:
        out += f"          {text(unit.comment)}\n"
    lines = [line[4:] if line.startswith("    ") else line for line in unit.text.strip("\n ").splitlines()]
    lines[0] = lines[0].lstrip()
    body = escape("\n".join(lines))
    return out + f'        </interface>\n        <body><ST><xhtml:p xml:space="preserve">{body}\n</xhtml:p></ST></body>\n      </pou>\n'


def project(files):
    library = st.Library()
    own = set(library.units)
    for file in files:
        library.add(Path(file).read_text(), Path(file).name)
    return (HEAD + "  <types>\n    <dataTypes>\n" + "".join(data_type(*entry) for entry in library.types.items()) + "    </dataTypes>\n    <pous>\n"
            + "".join(pou(unit) for name, unit in library.units.items() if name not in own)
            + "    </pous>\n  </types>\n  <instances><configurations/></instances>\n</project>\n")


if __name__ == "__main__":
    sys.stdout.write(project(sys.argv[1:]))
