"""Any environment of TorchRL, by what makes it: single ones with Gymnasium's face, side by side."""
