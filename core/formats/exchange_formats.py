"""Every format that `gruber export` and `gruber import` know, by its name."""

from collections.abc import Mapping

from core.formats.arcgis import ARCGIS_FORMAT
from core.formats.asp import ASP_FORMAT
from core.formats.bingo import BINGO_FORMAT
from core.formats.bundler import BUNDLER
from core.formats.colmap import COLMAP
from core.formats.eo_format import EO_FORMATS
from core.formats.exchange import ExchangeFormat
from core.formats.geojson import GEOJSON_FORMAT
from core.formats.ign_opk import OPK_FORMAT
from core.formats.inpho import INPHO_FORMAT
from core.formats.measurement_list import MEASUREMENTS
from core.formats.metashape import METASHAPE
from core.formats.micmac import MICMAC
from core.formats.mmvii import MMVII
from core.formats.opensfm import ODM, OPENSFM
from core.formats.outlines import FOOTPRINTS_FORMAT
from core.formats.pat_b import PATB_FORMAT
from core.formats.pix4d import PIX4D_POINTS
from core.formats.point_files import POINT_FORMATS
from core.formats.qgis_exchange import QGIS
from core.formats.stac import STAC_FORMAT

FORMATS: Mapping[str, ExchangeFormat] = {
    one.name: one
    for one in (
        MICMAC,
        COLMAP,
        BUNDLER,
        MMVII,
        QGIS,
        METASHAPE,
        OPENSFM,
        ODM,
        *EO_FORMATS,
        OPK_FORMAT,
        PATB_FORMAT,
        BINGO_FORMAT,
        INPHO_FORMAT,
        ASP_FORMAT,
        ARCGIS_FORMAT,
        *POINT_FORMATS,
        PIX4D_POINTS,
        MEASUREMENTS,
        GEOJSON_FORMAT,
        FOOTPRINTS_FORMAT,
        STAC_FORMAT,
    )
}
"""By the name that `--to` and `--from` take."""
