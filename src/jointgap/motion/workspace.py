"""What the integration of one motion works on: a record with room for any linkage.

Numbers of states, of loose joints and of their contacts are values in it: a loose revolute joint
has one contact, a loose slide four, its corners, after those of all revolute ones. Compiled code
and the machine code of the equations of motion read and write its fields directly.
"""

import numpy as np
from scipy.integrate import DOP853

from jointgap.contact.parameters import JointParameters
from jointgap.core.records import Record, record
from jointgap.linkage.parameters import MOST_PIVOTS, MOST_SLIDES

MOST_STATES, MOST_CONTACTS, MOST_RUBBING, MOST_SITES = 48, 16, 16, MOST_SLIDES + MOST_PIVOTS
"""Largest numbers of states, of contacts, of ideal joints with friction, and of pushed
joints."""

MOST_PARAMETERS, MOST_KEPT, MOST_CHANNELS = 512, 1024, 256
"""Room for the machine code."""

BLOCK = 8
"""Numbers that are summed together, two vectors."""

HERE, THERE, EVENT, INSIDE = range(4)
"""Rows: start of a step, its end, an event in it, another instant in it."""

KEPT = 16
"""Number of stages of a step: its own, the rates at its end, and three for the interpolant."""

TERMS = 4 + len(DOP853.D)
"""Number of terms of the interpolant."""

EPISODE = 4
"""Quantities of a contact: impulse [N s], largest normal force [N], maxima of the penetration,
begin [s]."""

CORNERS = 4
"""Contacts of a loose slide."""

CONDITIONS = 5
"""Numbers of `jointgap.motion.events.conditions`."""

_ROWS = 4

WORKSPACE = np.dtype(
    (
        Record,
        [
            ("rates", "f8", (KEPT, MOST_STATES)),  # Over s, by stage
            ("y", "f8", (_ROWS, MOST_STATES)),
            ("dy", "f8", (_ROWS, MOST_STATES)),
            ("z", "f8", (MOST_STATES,)),  # State at which rates are evaluated
            ("slope", "f8", (MOST_STATES,)),  # Its rates
            ("weights", "f8", (MOST_STATES,)),  # Of errors
            ("terms", "f8", (TERMS, MOST_STATES)),  # Of the interpolant
            # Fields of the machine code, see `jointgap.linkage.compiled.Variant`
            ("crank", "f8", (4,)),
            ("turning", "f8", (2 * (MOST_CONTACTS + MOST_RUBBING),)),
            ("sites", "f8", (2 * MOST_SITES,)),
            ("forces", "f8", (4 * MOST_CONTACTS + 1,)),
            ("along", "f8", (MOST_SITES,)),
            ("moments", "f8", (MOST_RUBBING,)),
            ("reactions", "f8", (2 * MOST_RUBBING + MOST_SITES,)),
            ("assumed", "f8", (2 * MOST_RUBBING + MOST_SITES,)),  # Reactions that give friction
            ("settled", "f8", (_ROWS, 2 * MOST_RUBBING + MOST_SITES)),  # Those of the rows
            ("parameters", "f8", (MOST_PARAMETERS,)),
            ("kept", "f8", (MOST_KEPT,)),
            ("channels", "f8", (MOST_CHANNELS,)),
            # Contacts
            ("conditions", "f8", (_ROWS, MOST_CONTACTS, CONDITIONS)),
            ("normal", "f8", (_ROWS, MOST_CONTACTS)),  # Normal forces [N]
            ("normals", "f8", (MOST_CONTACTS, DOP853.n_stages)),
            ("force", "f8", (MOST_CONTACTS,)),  # Normal forces at the state z
            ("damping", "f8", (MOST_CONTACTS,)),
            ("approaches", "f8", (MOST_CONTACTS,)),
            ("begins", "f8", (MOST_CONTACTS,)),
            ("masses", "f8", (MOST_CONTACTS,)),  # Typical mass of an impact [kg]
            ("turns", "f8", (MOST_CONTACTS,)),  # Of the clearance vectors
            ("seen", "f8", (MOST_CONTACTS, 4)),  # Those and their rates, when last counted
            ("joints", record(JointParameters()).dtype, (MOST_CONTACTS,)),
            ("episodes", "f8", (MOST_CONTACTS, EPISODE)),
            ("earlier", "f8", (MOST_CONTACTS, EPISODE)),  # Episodes before the last step
            ("modes", "i8", (MOST_CONTACTS,)),
            ("levers", "f8", (MOST_RUBBING,)),  # [m] Friction radii of ideal joints
            ("unloaded", "f8", (MOST_SITES,)),  # Forces along, without friction by reactions
            ("loaded", "f8", (MOST_SITES,)),  # The latter over the reactions
            ("grips", "f8", (MOST_RUBBING,)),  # [m] The same with the sign of the rotation
            # Instants
            ("time", "f8", (_ROWS,)),
            ("angle", "f8", (_ROWS,)),
            ("cosine", "f8", (_ROWS,)),
            ("sine", "f8", (_ROWS,)),
            ("now", "f8"),  # Time and crank angle at the state z
            ("turned", "f8"),
            ("cosines", "f8", (DOP853.n_stages,)),  # Of a steadily turning crank, by stage
            ("sines", "f8", (DOP853.n_stages,)),
            ("seen_time", "f8"),
            ("proposal", "f8"),  # [s] Length of the next step
            ("s", "f8"),  # Its start in the variable of its time map
            ("time_map", "i8"),
            ("origin", "f8"),  # Crank angle of the event from which s counts
            ("records", "i8"),  # Whether accepted steps are recorded
            ("inertia", "f8"),  # [kg m] Times the square of the crank's speed: inertia forces
            # Sizes
            ("states", "i8"),
            ("half", "i8"),  # Positions, and velocities
            ("blocks", "i8"),
            ("loose", "i8"),
            ("pins", "i8"),  # Those of them that are revolute, the first ones
            ("contacts", "i8"),
            ("rubbing", "i8"),
            ("pushed", "i8"),
            ("slides", "i8"),  # Those of them that are slides, the first ones
            ("is_free", "i8"),
            ("rubs", "i8"),
            ("bristles", "i8"),
            ("pose", "i8"),  # Addresses of machine code and of this record
            ("dynamics", "i8"),
            ("sample", "i8"),
            ("place", "i8"),
        ],
    )
)
"""What the integration of one motion works on."""
