"""The equations of motion: bodies, joints, contact, friction, film, drive, effects."""
