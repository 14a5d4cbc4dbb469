"""Names of scans as lists have them."""


def scan_stem(name: str) -> str:
    """A scan's name without folder (of any system) and image extension; case is kept."""
    plain = name.strip().replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, extension = plain.rpartition(".")
    known = {"tif", "tiff", "jpg", "jpeg", "jp2", "j2k", "png", "img", "vrt"}
    return stem if dot and extension.lower() in known else plain
