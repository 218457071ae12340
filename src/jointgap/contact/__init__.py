"""Contact, friction and films in revolute joints; no mechanism."""
