"""The synthetic world: aerial camera motion, tabletop scenes, sequences, AerialPose-Sim."""
