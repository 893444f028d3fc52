"""What a command says of wrong input."""


def assert_one_clear_line(done, *words):
    """Exit code 2, and one line on stderr that has all the words."""
    assert done.returncode == 2, done.stdout + done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("nico-selfmodel: ")
    assert all(str(word) in lines[0] for word in words), lines[0]
