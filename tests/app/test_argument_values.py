"""Values that are typed behind options."""

import argparse

import pytest

from app.argument_values import proxy_address


@pytest.mark.parametrize(
    ("typed", "address"),
    [
        ("https://desk.example.org", "https://desk.example.org"),
        ("https://Desk.Example.org/ ", "https://desk.example.org"),
        ("http://10.0.0.7:8080", "http://10.0.0.7:8080"),
        ("http://[::1]:8080", "http://[::1]:8080"),
        ("", ""),
    ],
)
def test_an_address_is_kept_without_its_end__truth(typed: str, address: str):
    assert proxy_address(typed) == address


@pytest.mark.parametrize(
    "typed",
    ["desk.example.org", "ftp://desk.example.org", "https://", "https://a/path", "https://a?b=c",
     "https://me@a", "https://a b", "https://*", "https://a.", "https://münchen.de",
     "https://a:port", "https://a:", "https://[::1"],
)  # fmt: skip
def test_what_is_no_address_is_refused__law(typed: str):
    with pytest.raises(argparse.ArgumentTypeError, match=r"example\.org"):
        proxy_address(typed)
