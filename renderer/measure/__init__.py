"""Speed against accuracy, measured: which settings buy how much certainty per second on a given scene.

result = measure("cornell-box", seconds=3.0)
for row in result.rows: print(row.name, row.efficiency, row.times)
result.recommended(60.0)
"""

from renderer.measure.candidates import Candidate, candidates
from renderer.measure.result import Measurement, Point, Row, TimeTo
from renderer.measure.run import Measuring, measure

__all__ = ["Candidate", "Measurement", "Measuring", "Point", "Row", "TimeTo", "candidates", "measure"]
