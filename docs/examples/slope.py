"""Slope and relief from a folder of images and attitudes.csv (time_s, roll_deg, pitch_deg, yaw_deg per image)."""

import math
import sys
from pathlib import Path

import cv2
import numpy as np

from landing import CameraModel, Observation, Options, SurfacePipeline, matrix_from_euler

folder, focal_px = Path(sys.argv[1]), float(sys.argv[2])
images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(folder.glob("*.png"))]
height, width = images[0].shape
pipeline = SurfacePipeline(CameraModel.from_focal(width, height, focal_px), Options())
rows = np.loadtxt(folder / "attitudes.csv", delimiter=",", skiprows=1)
for frame, (image, (time_s, *angles_deg)) in enumerate(zip(images, rows, strict=True)):
    ned_from_body = matrix_from_euler(*(math.radians(angle) for angle in angles_deg))
    estimate = pipeline.step(Observation(frame, time_s, image, ned_from_body))
    print(
        f"{frame} {estimate.status}: inclination {estimate.inclination_deg:.2f} deg"
        f" +- {estimate.inclination_std_deg:.2f}, relief {estimate.roughness:.4f} of the distance"
    )
