"""A stiff cube (E = 100 Pa) pressed into a soft block (E = 1 Pa): affine cells, a singularity.

The stress is singular along the edges of the cube's footprint; that is where the mesh is refined. The standard
benchmark models all four quarters at a tolerance of 6 %:

    mpirun -n 2 python3 demos/indentation.py --symmetry full --tolerance 0.06
"""

from common import main, parser

from fx_contact import Material
from fx_contact.scenes import indentation

options = parser(__doc__, tolerance=0.1, order=1, coarse=4, output="results/indentation", whole=True)
options.add_argument("--displacement", type=float, default=0.01, help="of the cube's top (%(default)s)")
options.add_argument("--ratio", type=float, default=100.0, help="of the cube's to the block's modulus (%(default)s)")


def scene(arguments, block):
    """The cube and the block that the arguments describe."""
    cube = Material(arguments.ratio * arguments.young, arguments.poisson)
    return indentation(
        displacement=arguments.displacement,
        block=block,
        cube=cube,
        order=arguments.order,
        coarse=arguments.coarse,
        symmetry=arguments.symmetry,
    )


if __name__ == "__main__":
    main(options, scene)
