"""What every refusal on the command line looks like."""


def refused(found, *words):
    """Assert that a command, given by exit status and outputs, ended in 2 and one line with some words."""
    code, out, err = found
    assert code == 2
    assert out == ""
    assert err.startswith("whitted: error: ")
    assert err.count("\n") == 1, err
    for word in words:
        assert word in err
