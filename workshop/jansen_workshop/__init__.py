"""jansen_workshop: drawings, predictions and measurements of a walking machine to build."""
