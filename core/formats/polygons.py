"""Polygons into a GeoPackage, with what a full disk does to it."""

import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyogrio
import pyogrio.raw
import shapely
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError
from shapely.geometry.base import BaseGeometry

NO_TIME = "2000-01-01T00:00:00Z"
"""When every layer was written last: the same run gives the same bytes."""


def write_polygons(
    path: Path,
    layer: str,
    areas: Sequence[BaseGeometry],
    fields: Mapping[str, np.ndarray],
    crs: str,
    append: bool = False,
) -> None:
    """Write one layer of polygons or multipolygons.

    Args:
        path: The GeoPackage, in a folder that can be written to.
        layer: Name of the layer.
        areas: Geometries of one kind.
        fields: Attributes by name, one value for each geometry.
        crs: CRS of the coordinates.
        append: Put the layer into the file that is there.

    Raises:
        OSError: The disk is full.
    """
    several = any(isinstance(area, shapely.MultiPolygon) for area in areas)
    # The time of writing that GDAL puts into a GeoPackage would make every run another file.
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": NO_TIME})
    try:
        pyogrio.raw.write(
            path,
            geometry=np.array([shapely.to_wkb(area) for area in areas], dtype=object),
            field_data=list(fields.values()),
            fields=np.array(list(fields), dtype=object),
            geometry_type="MultiPolygon" if several else "Polygon",
            crs=crs,
            driver="GPKG",
            layer=layer,
            append=append,
        )
    except (DataSourceError, DataLayerError, FeatureError) as error:
        # The folder has been found to be writable: only room for what is put in may be lacking.
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
    finally:
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})
