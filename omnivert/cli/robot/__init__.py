"""Commands on a robot: start it, set it up, watch it, steer it, ask what is wrong, take its result."""
