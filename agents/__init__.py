"""Agents for the Jansen environments: PID and constant torque, training, evaluation."""
