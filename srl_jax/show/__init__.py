"""A robot on the stage: it walks, its damage strikes, a policy walks on; as a video, or in MuJoCo's viewer."""
