"""Lines of text files, and names of scans as lists have them."""

from core.formats.records import scan_stem


def test_names_lose_folder_and_image_extension_only__truth() -> None:
    assert scan_stem("LMSA08.1938.HUST25.00859") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("a/b/LMSA08.1938.HUST25.00859.TIF") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("C:\\scans\\1989_16401.jp2") == "1989_16401"
