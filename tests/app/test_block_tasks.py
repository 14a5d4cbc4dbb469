"""Lists of blocks of every kind, and those that cannot be used."""

import pytest

from app.block_tasks import read_list
from app.block_toml import BATCH_TABLE
from core.errors import ProjectError
from tests.app.test_batch import block


@pytest.fixture
def three(tmp_path):
    return [block(tmp_path / "archive" / name) for name in ("a", "b", "c")]


def test_a_folder_a_file_and_a_table_list_the_same_blocks__truth(tmp_path, three):
    listed = tmp_path / "list.txt"
    listed.write_text("# rolls\n\narchive/a\narchive/b/block.toml\narchive/c\n", encoding="utf-8")
    table = tmp_path / "list.csv"
    table.write_text("block,until\narchive/a,\narchive/b,ties\narchive/c,\n", encoding="utf-8")
    for source in (tmp_path / "archive", tmp_path / "arch*" / "[abc]", listed, table):
        assert [task.block.resolve() for task in read_list(source)] == three
    assert [task.until for task in read_list(table)] == ["", "ties", ""]
    # As spreadsheets of other languages and R write it.
    for sign in ";\t":
        table.write_text(f'"block"{sign}"until"\n"archive/a"{sign}"ties"\n', encoding="utf-8")
        assert [(one.block.name, one.until) for one in read_list(table)] == [("a", "ties")]


def test_a_higher_priority_runs_first__truth(tmp_path, three):
    table = tmp_path / "list.csv"
    table.write_text("priority,block\n1,archive/a\n,archive/b\n7.5,archive/c\n", encoding="utf-8")
    assert [task.block.name for task in read_list(table)] == ["c", "a", "b"]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "lists no block"),
        ("archive/a\narchive/nowhere\n", "archive/nowhere"),
        ("archive/a\narchive/a/block.toml\n", "more than once"),
        ("block,until\narchive/a,landing\n", "landing"),
        ("block,colour\narchive/a,red\n", "colour"),
        ("block,priority\narchive/a,high\n", "no number"),
        ("block,priority\narchive/a,nan\n", "no number"),
        ("priority,block\n3\n", "row without a block"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_a_list_that_cannot_be_used_is_refused_by_name__law(tmp_path, three, text, cause):
    source = tmp_path / "list.csv"
    source.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ProjectError, match=cause):
        read_list(source)
    assert not (tmp_path / BATCH_TABLE).exists()


def test_a_link_to_a_block_beside_it_is_no_second_block__law(tmp_path, three):
    archive = three[0].parent
    (archive / "0-link").symlink_to("a")
    for source in (archive, archive / "*"):
        assert [task.block.name for task in read_list(source)] == ["a", "b", "c"]
    (tmp_path / "lone").symlink_to(three[1])
    assert [task.block.name for task in read_list(tmp_path / "lone*")] == ["lone"]


def test_a_list_that_is_not_there_is_told_so__truth(tmp_path):
    with pytest.raises(ProjectError, match="does not exist"):
        read_list(tmp_path / "list.csv")
