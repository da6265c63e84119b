"""Write the page of every vehicle of the catalogue: `python docs/vehicles.py` makes docs/vehicles/*.md again."""

from pathlib import Path

from seatrial.core.files import write_text
from seatrial.report.vehicle_page import vehicle_page
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

PAGES = Path(__file__).parent / "vehicles"

if __name__ == "__main__":
    PAGES.mkdir(exist_ok=True)
    for name in vehicle_names():
        write_text(PAGES / f"{name}.md", vehicle_page(name, load_vehicle(name)))
