"""``python -m skyscatter``: the program, where its script is not on the path."""

from skyscatter.cli.start import program

if __name__ == "__main__":
    program()
