"""The PhantomX hexapod: its model, its damage, its tasks and its MJX environment."""
