"""`6pack-fixed`: `6pack` with the ground truth freed of its NOCS scale, matched by instance.

Everything else stays, the `nocs_official` IoU and the gate on the errors included: it tells what
the bugs alone are worth. For the truth about a tracker see `aerial`.
"""

from __future__ import annotations

from collections.abc import Sequence

from robust6dof.evaluation.protocols.six_pack import score_batch
from robust6dof.evaluation.records import PoseBatch, PoseRecord, by_category
from robust6dof.evaluation.scores import Scores


def score(records: Sequence[PoseRecord]) -> Scores:
    batch = PoseBatch(records, [by_category(record) for record in records])
    return score_batch("6pack-fixed", batch, batch.extents_true)
