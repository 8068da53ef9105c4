"""The store's tables are those that are documented, and a store tells what is wrong with it."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from studies import TOY

from whitted.errors import UsageError
from whitted.studies import schema
from whitted.studies.store import DATABASE, Store
from whitted.studies.study import study

ROOT = Path(__file__).parents[1]


def test_the_document_is_the_schema():
    document = ROOT / "docs/store.md"
    if not document.is_file():
        pytest.skip("no documents beside the tests")
    assert document.read_text() == schema.describe(), "write schema.describe() to docs/store.md"


def test_every_column_says_what_it_means():
    for table, (meaning, columns) in schema.TABLES.items():
        assert meaning.endswith("."), table
        assert all(text for _, text in columns.values()), table


def test_a_store_has_these_tables_and_no_others(tmp_path):
    Store(tmp_path / "s", write=True).close()
    with closing(sqlite3.connect(tmp_path / "s" / DATABASE)) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        assert sorted(tables) == sorted(schema.TABLES)
        for table, (_, columns) in schema.TABLES.items():
            found = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
            assert found == list(columns)
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert database.execute("PRAGMA user_version").fetchone() == (schema.VERSION,)


def test_rows_refer_to_rows_that_are_there(tmp_path):
    found = study(TOY, tmp_path / "s")
    with closing(sqlite3.connect(found.folder / DATABASE)) as database:
        assert database.execute("PRAGMA foreign_key_check").fetchall() == []
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_a_transaction_is_whole_or_nothing(tmp_path):
    def broken(store):
        with store.transaction():
            store.insert("runs", {"specification": "{}", "digest": "a", "started": "now"})
            raise KeyError

    with Store(tmp_path / "s", write=True) as store:
        with pytest.raises(KeyError):
            broken(store)
        assert store.query("SELECT * FROM runs") == []


def test_a_query_that_is_wrong_is_one_line(tmp_path):
    with Store(tmp_path / "s", write=True) as store, pytest.raises(UsageError, match="no such table: cell"):
        store.query("SELECT * FROM cell")


def test_reading_makes_nothing(tmp_path):
    with pytest.raises(UsageError, match="no study lies there"):
        Store(tmp_path)
    assert list(tmp_path.iterdir()) == []
    Store(tmp_path / "s", write=True).close()
    with Store(tmp_path / "s") as store, pytest.raises(UsageError, match="readonly"), store.transaction():
        store.insert("runs", {"specification": "{}", "digest": "a", "started": "now"})
