"""Names of the numbers of a raster, beside it in GDAL's `.aux.xml`: categories and a table.

QGIS lists a layer by its categories in their colours, and shows the table with all columns.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

from core.formats.xml_files import add

# source: GDAL, GDALRATFieldType and GDALRATFieldUsage
WHOLE, TEXT = "0", "2"
VALUE, NAME, OTHER = "5", "2", "0"


def write_raster_table(
    raster: Path, rows: Mapping[int, Sequence[str]], columns: Sequence[str]
) -> None:
    """Write what the numbers of a raster's first band mean, beside it.

    Args:
        raster: The raster; `.aux.xml` is added to its name.
        rows: Texts of each number, the first of which names it; numbers from 0.
        columns: What the texts are called.
    """
    root = ElementTree.Element("PAMDataset")
    band = ElementTree.SubElement(root, "PAMRasterBand", band="1")
    names = add(band, "CategoryNames")
    for number in range(max(rows, default=-1) + 1):
        add(names, "Category", rows[number][0] if number in rows else "")
    table = ElementTree.SubElement(band, "GDALRasterAttributeTable", tableType="thematic")
    kinds = [WHOLE, *(TEXT for _ in columns)]
    usages = [VALUE, NAME, *(OTHER for _ in columns[1:])]
    for index, (name, kind, usage) in enumerate(
        zip(["number", *columns], kinds, usages, strict=True)
    ):
        field = ElementTree.SubElement(table, "FieldDefn", index=str(index))
        add(field, "Name", name)
        add(field, "Type", kind)
        add(field, "Usage", usage)
    for index, (number, texts) in enumerate(sorted(rows.items())):
        row = ElementTree.SubElement(table, "Row", index=str(index))
        for text in (str(number), *texts):
            add(row, "F", text)
    ElementTree.indent(root)
    # GDAL reads none that begins with a declaration.
    beside = raster.with_name(f"{raster.name}.aux.xml")
    beside.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=False))
