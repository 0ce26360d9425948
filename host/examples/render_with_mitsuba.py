"""Renders a sphere of an exported BRDF with Mitsuba 3.

    rcg export m/ --to bsdf --out m.bsdf
    pip install mitsuba
    python render_with_mitsuba.py m.bsdf sphere.png
"""

import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")


def main(bsdf, picture):
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {
                "type": "perspective",
                "fov": 25,
                "film": {"type": "hdrfilm", "width": 256, "height": 256},
                "to_world": mi.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1]),
            },
            "light": {"type": "directional", "direction": [0.5, 1, -0.5], "irradiance": 3.0},
            # +x of the sample runs around the sphere's z axis.
            "ball": {"type": "sphere", "bsdf": {"type": "measured", "filename": bsdf}},
        }
    )
    mi.util.write_bitmap(picture, mi.render(scene, spp=16))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2])
