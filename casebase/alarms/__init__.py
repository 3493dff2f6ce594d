"""Who is told what: rules over states of gearboxes, receivers, and the outbox of their messages."""
