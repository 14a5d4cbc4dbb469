"""Versions of the session file: the SQL that upgrades each to the next."""

from dataclasses import dataclass

GEOPACKAGE_ID = 0x47504B47
"""`application_id` of a GeoPackage ("GPKG")."""
GEOPACKAGE_VERSION = 10400
"""`user_version` of GeoPackage 1.4."""


@dataclass(frozen=True, slots=True)
class Migration:
    """One step from a version of the session file to the next."""

    version: int
    """The version the file has afterwards."""
    statements: tuple[str, ...]
    """SQL, run in one transaction together with the new version number."""


_GEOPACKAGE = (
    """CREATE TABLE gpkg_spatial_ref_sys (
        srs_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL PRIMARY KEY,
        organization TEXT NOT NULL,
        organization_coordsys_id INTEGER NOT NULL,
        definition TEXT NOT NULL,
        description TEXT)""",
    """CREATE TABLE gpkg_contents (
        table_name TEXT NOT NULL PRIMARY KEY,
        data_type TEXT NOT NULL,
        identifier TEXT UNIQUE,
        description TEXT DEFAULT '',
        last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
        min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
        srs_id INTEGER,
        CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id))""",
    """CREATE TABLE gpkg_geometry_columns (
        table_name TEXT NOT NULL,
        column_name TEXT NOT NULL,
        geometry_type_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL,
        z TINYINT NOT NULL,
        m TINYINT NOT NULL,
        CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
        CONSTRAINT uk_gc_table_name UNIQUE (table_name),
        CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
        CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id))""",
    """CREATE TABLE gpkg_extensions (
        table_name TEXT,
        column_name TEXT,
        extension_name TEXT NOT NULL,
        definition TEXT NOT NULL,
        scope TEXT NOT NULL,
        CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))""",
    """INSERT INTO gpkg_spatial_ref_sys VALUES
        ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', NULL),
        ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL),
        ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",'
         || 'SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
         || 'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
         || 'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],'
         || 'AUTHORITY["EPSG","4326"]]', NULL)""",
    f"PRAGMA application_id = {GEOPACKAGE_ID}",
    f"PRAGMA user_version = {GEOPACKAGE_VERSION}",
)

# Decisions are appended and nothing else: the triggers hold even against a table edited in QGIS.
_DECISIONS = (
    "CREATE TABLE gruber_version (version INTEGER NOT NULL)",
    "INSERT INTO gruber_version VALUES (0)",
    """CREATE TABLE decisions (
        decision_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
        recorded TEXT NOT NULL,
        who TEXT NOT NULL,
        kind TEXT NOT NULL,
        decision TEXT NOT NULL)""",
    """CREATE TRIGGER decisions_never_change BEFORE UPDATE ON decisions
        BEGIN SELECT RAISE(ABORT, 'decisions are only appended'); END""",
    """CREATE TRIGGER decisions_never_vanish BEFORE DELETE ON decisions
        BEGIN SELECT RAISE(ABORT, 'decisions are only appended'); END""",
    """INSERT INTO gpkg_contents (table_name, data_type, identifier, description)
        VALUES ('decisions', 'attributes', 'decisions', 'What the operators decided, in order')""",
)

MIGRATIONS: tuple[Migration, ...] = (Migration(1, _GEOPACKAGE + _DECISIONS),)
"""All steps in order; a new version is one more entry, and no entry ever changes."""


def newest() -> int:
    """The version this program writes."""
    return MIGRATIONS[-1].version


def steps_from(version: int) -> tuple[Migration, ...]:
    """The migrations that a file of some version still needs; 0 is an empty file."""
    return tuple(step for step in MIGRATIONS if step.version > version)
