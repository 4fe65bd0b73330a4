"""The command line: one file a command. Results go to stdout, progress and messages to stderr.

Exit status: 0 done; 1 something given cannot be used, or no result could be made (the message says what to do);
2 a wrong command line; 3 a mistake of Pomona's own; 130 stopped by Ctrl-C.
"""


def main() -> None:
    """Run `pomona`."""
    from pomona.cli.app import app

    app()
