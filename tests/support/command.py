"""The command in this process, which has its libraries loaded."""

from typer.testing import CliRunner, Result

from doppelgait.cli.app import app


def run(*words: object, code: int = 0) -> Result:
    """Run the command; what it raises is raised, and another exit status is a failure."""
    done = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == code, done.output
    return done
