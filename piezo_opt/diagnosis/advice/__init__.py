"""What to measure next: the drive that splits effects alike, or shows those that were hidden.

On each candidate drive the fitted model gives the derivatives by its own parameters and by the
gates of absent effects; what the parameters explain is projected out, on the new drive, with its
unknown start. What is left says how surely the new record will tell.

Source: Box & Hill (1967), Technometrics 9(1), 57-71 (experiments that discriminate among models);
Atkinson & Fedorov (1975), Biometrika 62(1), 57-70 (T-optimality: the distance to the rival's best
fit).
"""

from piezo_opt.diagnosis.advice.experiment import Advice
from piezo_opt.diagnosis.advice.plan import experiments
from piezo_opt.diagnosis.advice.revealing import reveal
from piezo_opt.diagnosis.advice.splitting import advise
from piezo_opt.diagnosis.advice.writing import write_drives

__all__ = ["Advice", "advise", "experiments", "reveal", "write_drives"]
