"""Pictures that are kept."""


def with_few_colours(path):
    """Write a PNG again with a palette: a third of its size, where it has no smooth shades."""
    from PIL import Image  # not at the top: tables are made without it

    Image.open(path).quantize(256).save(path, optimize=True)
