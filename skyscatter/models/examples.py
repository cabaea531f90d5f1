"""An example of every kind that a model file can name, as one would write it there."""

from __future__ import annotations

#: By the group of kinds (`skyscatter.models.catalogue.groups`) and the kind.
EXAMPLES: dict[str, dict[str, str]] = {
    "densities of skies": {
        "exponential": '{ kind = "exponential", scale_height = "8 km" }',
        "uniform": '{ kind = "uniform", base = "0 m", top = "500 m" }',
        "tent": '{ kind = "tent", base = "10 km", peak = "25 km", top = "40 km" }',
        "gaussian": '{ kind = "gaussian", peak = "22 km", width = "5 km" }',
        "chapman": '{ kind = "chapman", peak = "90 km", scale_height = "6 km" }',
        "tabulated": '{ kind = "tabulated", altitudes = [0, "1 km", "3 km"], densities = [1.0, 0.6, 0.1] }',
        "us-standard-1976": '{ kind = "us-standard-1976" }',
    },
    "densities in space": {
        "everywhere": '{ kind = "everywhere" }',
        "sphere": '{ kind = "sphere", radius = "0.1 pc" }',
        "gaussian-sphere": '{ kind = "gaussian-sphere", width = "0.1 pc" }',
        "plummer": '{ kind = "plummer", radius = "0.05 pc" }',
        "king": '{ kind = "king", core = "0.1 pc", cut = "1 pc" }',
        "power-law": '{ kind = "power-law", core = "0.01 pc", exponent = 2, cut = "1 pc" }',
        "bonnor-ebert": '{ kind = "bonnor-ebert", radius = "0.1 pc" }',
        "shell": '{ kind = "shell", inner = "0.2 pc", outer = "0.3 pc" }',
        "gaussian-shell": '{ kind = "gaussian-shell", radius = "0.3 pc", width = "0.02 pc" }',
        "flared-disk": '{ kind = "flared-disk", radius = "100 au", height = "10 au", inner = "1 au", '
        'outer = "300 au" }',
        "cone": '{ kind = "cone", half_angle_deg = 30, length = "0.5 pc" }',
        "bipolar-lobes": '{ kind = "bipolar-lobes", length = "0.4 pc", width = "0.2 pc" }',
        "slab": '{ kind = "slab", half_thickness = "10 m" }',
        "box": '{ kind = "box", half_sizes = ["1 m", "2 m", "1 m"] }',
        "filament": '{ kind = "filament", points = [[0, 0, 0], ["1 pc", 0, "0.3 pc"]], width = "0.05 pc" }',
        "turbulence": '{ kind = "turbulence", outer_scale = "1 pc", inner_scale = "0.1 pc", seed = 5 }',
        "front": '{ kind = "front", radii = [["1 pc"], ["1.5 pc"], ["1 pc"]], width = "0.01 pc" }',
        "around-planet": '{ kind = "around-planet", position = [0, 0, "-6371 km"], radius = "6371 km", '
        'profile = { kind = "exponential", scale_height = "8 km" } }',
        "voxels": '{ kind = "voxels", spacing = "1 m", values = [[[0.0, 1.0], [0.5, 0.2]]] }',
        "sph-particles": '{ kind = "sph-particles", positions = [[0, 0, 0], [1, 0, 0]], masses = [1, 1], '
        'smoothing_lengths = [0.5, 0.5], length_unit = "1 pc" }',
        "move": '{ kind = "move", field = { kind = "sphere", radius = "1 pc" }, by = ["2 pc", 0, 0] }',
        "rotate": '{ kind = "rotate", field = { kind = "cone", half_angle_deg = 20, length = "1 pc" }, axis = [1, 0, '
        "0] }",
        "scale": '{ kind = "scale", field = { kind = "sphere", radius = "1 pc" }, factors = [1, 1, 0.5] }',
        "product": '{ kind = "product", fields = [{ kind = "sphere", radius = "1 pc" }, '
        '{ kind = "turbulence", outer_scale = "1 pc", inner_scale = "0.1 pc" }] }',
        "sum": '{ kind = "sum", factors = [1, 3], fields = [{ kind = "sphere", radius = "1 pc" }, '
        '{ kind = "sphere", radius = "0.3 pc" }] }',
        "carve": '{ kind = "carve", field = { kind = "sphere", radius = "1 pc" }, by = { kind = "sphere", '
        'radius = "0.5 pc" } }',
        "power": '{ kind = "power", field = { kind = "plummer", radius = "1 pc" }, exponent = 2 }',
        "warp": '{ kind = "warp", field = { kind = "sphere", radius = "1 pc" }, amplitude = "0.1 pc", '
        'scale = "0.5 pc" }',
        "ionised": '{ kind = "ionised", gas = { kind = "sphere", radius = "1 pc" }, hydrogen_density = "100 cm-3", '
        'sources = [{ ionising_photons = "1e48 s-1" }] }',
        "sampled": '{ kind = "sampled", cells = 32, field = { kind = "sphere", radius = "1 pc" } }',
    },
    "optics": {
        "rayleigh": '{ kind = "rayleigh", coefficient = "1.2e-2 km-1", wavelength = "550 nm" }',
        "rayleigh-air": '{ kind = "rayleigh-air" }',
        "particles": '{ kind = "particles", optical_depth = 0.2, angstrom_exponent = 1.3, '
        'single_scattering_albedo = "95%", phase = { kind = "henyey-greenstein", g = 0.7 } }',
        "mie": '{ kind = "mie", material = "water", optical_depth = 0.3, '
        'modes = [{ median_radius = "5 um", geometric_standard_deviation = 1.4, max_radius = "14 um" }] }',
        "gas-absorption": '{ kind = "gas-absorption", species = "o3", column_du = "300 DU" }',
        "absorption-table": '{ kind = "absorption-table", number_density = "1e12 cm-3", '
        'cross_section = { wavelengths = [400, 700], values = ["2e-20 cm2", "1e-21 cm2"] } }',
        "dust": '{ kind = "dust", visual_extinction = "2 mag" }',
        "gas-lines": '{ kind = "gas-lines", electron_density = "100 cm-3", ratios = { oiii_5007 = 3.0 } }',
        "artist": '{ kind = "artist", colour = 0.8, distance = "2 mm" }',
    },
    "phase functions": {
        "isotropic": '{ kind = "isotropic" }',
        "rayleigh": '{ kind = "rayleigh", depolarisation = 0.028 }',
        "henyey-greenstein": '{ kind = "henyey-greenstein", g = 0.7 }',
        "double-henyey-greenstein": '{ kind = "double-henyey-greenstein", g_forward = 0.8, g_backward = -0.4, '
        'forward_fraction = "90%" }',
        "cornette-shanks": '{ kind = "cornette-shanks", g = 0.7 }',
        "draine": '{ kind = "draine", g = 0.6, alpha = 0.5 }',
        "phase-table": '{ kind = "phase-table", cos_theta = [-1, 0, 1], wavelengths = [550], values = [[1], [0.5], '
        "[4]] }",
        "greek": '{ kind = "greek", alpha1 = [1, 0, 0.5], alpha2 = [0, 0, 3], alpha3 = [0, 0, 0], '
        "alpha4 = [0, 1.5, 0], beta1 = [0, 0, -1.224744871391589], beta2 = [0, 0, 0] }",
    },
    "lamps": {
        "point": '{ kind = "point", position = [0, 0, "10 m"], lumens = "800 lm", spectrum = "led-4000k" }',
        "spot": '{ kind = "spot", position = [0, 0, 3], target = [0, 0, 0], half_angle_deg = 15, watts = "20 W", '
        'spectrum = "led-2700k" }',
        "led": '{ kind = "led", position = [0, 0, 2], axis = [0, 0, -1], lumens = 100, spectrum = "led-4000k" }',
        "parallel": '{ kind = "parallel", azimuth_deg = 180, elevation_deg = 30, lux = 80000, spectrum = "sun" }',
        "environment": '{ kind = "environment", file = "dome.exr", turn_deg = 90 }',
        "surroundings": '{ kind = "surroundings", candela_per_m2 = 2e-4, spectrum = "sun" }',
    },
    "lobes": {
        "isotropic": '{ kind = "isotropic" }',
        "lambert": '{ kind = "lambert" }',
        "cosine-power": '{ kind = "cosine-power", half_angle_deg = 40 }',
        "cone": '{ kind = "cone", half_angle_deg = "20 deg", edge_deg = 5 }',
        "tabulated": '{ kind = "tabulated", angles_deg = [0, 30, 60, 90], intensities = [100, 80, 30, 0] }',
        "city": '{ kind = "city", ground_albedo = "15%" }',
    },
    "towns": {
        "town": '{ kind = "town", latitude_deg = 48.14, longitude_deg = 11.58, radius = "10 km", lumens = 4e8, '
        'spectrum = "high-pressure-sodium" }',
        "map": '{ kind = "map", file = "VNL_2023.tif", spectrum = "led-4000k" }',
    },
    "materials": {
        "interface": '{ kind = "interface" }',
        "lambert": '{ kind = "lambert", albedo = "30%" }',
        "mirror": '{ kind = "mirror", reflectance = 0.95 }',
        "mosaic": '{ kind = "mosaic", classes = [[0, 1], [1, 0]], materials = [{ kind = "lambert", albedo = "snow" }, '
        '{ kind = "sea" }], rest = { kind = "sea" }, cell_size = "2 km" }',
        "dielectric": '{ kind = "dielectric", roughness = 0.1 }',
        "conductor": '{ kind = "conductor", metal = "gold" }',
        "rpv": '{ kind = "rpv", amplitude = 0.07, exponent = 0.65, asymmetry = -0.29 }',
        "ross-li": '{ kind = "ross-li", isotropic = 0.09, volumetric = 0.05, geometric = 0.02 }',
        "sea": '{ kind = "sea", wind_speed = "8 m/s", upwelling = 0.02 }',
    },
    "shapes": {
        "sphere": '{ kind = "sphere", position = [0, 0, 1], radius = "30 cm" }',
        "plane": '{ kind = "plane", normal = [0, 0, 1] }',
        "rectangle": '{ kind = "rectangle", position = [0, 0, 0], normal = [0, 0, 1], size = ["2 m", "1 m"] }',
        "box": '{ kind = "box", position = [0, 0, 1], size = [1, 1, 2], turn_deg = "30 deg" }',
        "disk": '{ kind = "disk", position = [0, 0, 2], normal = [0, 0, -1], radius = "10 cm" }',
        "mesh": '{ kind = "mesh", vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces = [[0, 1, 2]] }',
        "turned": '{ kind = "turned", profile = [[0, 0], ["5 cm", 0], ["5 cm", "12 cm"]] }',
    },
    "cameras": {
        "panorama": '{ kind = "panorama", width = 360, height = 180 }',
        "fisheye": '{ kind = "fisheye", width = 256, height = 256, fov_deg = 180 }',
        "perspective": '{ kind = "perspective", width = 320, height = 240, fov_deg = 60 }',
        "planet": '{ kind = "planet", width = 256, height = 256 }',
        "telescope": '{ kind = "telescope", width = 256, height = 256, pixel_scale_deg = "2 arcsec" }',
    },
}

#: Tables without a kind.
TABLES: dict[str, str] = {
    "Planet": '{ name = "Earth", radius = "6371 km" }',
    "Ground": '{ albedo = "30%" }',
    "GroundMap": '{ classes = [[0, 1], [1, 1]], albedos = [0.1, "snow"], cell_size = "500 m" }',
    "Star": '{ spectrum = "blackbody", temperature = "4000 K", radius = "0.7 Rsun", distance = "0.3 AU" }',
    "Component": '{ name = "air", density = { kind = "us-standard-1976" }, optics = { kind = "rayleigh-air" } }',
    "View": '{ ra_deg = 83.82, dec_deg = -5.39, distance = "400 pc", inclination_deg = "30 deg" }',
    "PointStar": '{ name = "star", position = ["0.1 pc", 0, 0], temperature = "20000 K", luminosity = "3300 Lsun" }',
    "ParallelLight": '{ direction = [1, 0, 0], temperature = "10000 K", dilution = 1e-14 }',
    "StarField": "{ count_per_square_degree = 5000, limiting_magnitude = 20 }",
    "IonisingSource": '{ position = [0, 0, 0], ionising_photons = "1e49 s-1" }',
    "Viewpoint": '{ position = ["3 m", 0, "1.5 m"], target = [0, 0, 1] }',
    "SurfaceMedium": '{ name = "water", index = "water", components = [{ name = "milk", '
    'density = { kind = "everywhere" },'
    ' optics = { kind = "artist", colour = 0.9, distance = "1 mm" } }] }',
    "Body": '{ name = "ball", shape = { kind = "sphere", radius = "10 cm" }, material = { kind = "lambert", '
    "albedo = 0.5 } }",
    "AreaLamp": '{ lumens = 800, spectrum = "led-4000k" }',
    "LogNormalMode": '{ median_radius = "0.1 um", geometric_standard_deviation = 1.6 }',
    "SizeTable": '{ radii = ["0.1 um", "0.3 um", "1 um"], numbers = [1.0, 0.4, 0.01] }',
    "LineRatios": "{ oiii_5007 = 3.0, nii_6583 = 0.6 }",
    "SpectralTable": '{ wavelengths = [400, "0.7 um"], values = [0.1, 0.3] }',
}
